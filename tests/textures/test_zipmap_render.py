"""Laws of zipmap rendering, and its hard cases, on the GPU."""

import numpy as np
import pytest
from pxr import Gf, Sdf

from bench.zipmap_stage import (
    Patch,
    front_view,
    quad,
    render_texture,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography, images, mipmaps
from fexel.errors import FexelWarning
from fexel.textures.system import TextureSystem

WHOLE = front_view((0, 0), (1, 1), 64, 64)


def constant(path, color, size=(16, 16), **options):
    texels = np.broadcast_to(np.float32(color), (size[1], size[0], len(color))).copy()
    texels[..., :3] *= texels[..., 3:] if len(color) == 4 else 1
    return save(path, texels, **options)


def placed(low, high):
    """Matrix of an axis-aligned patch over low..high of its parent."""
    low, high = np.array(low, float), np.array(high, float)
    return homography.translate(*-low) @ homography.scale(*(1 / (high - low)))


def frame(gl, root, view=WHOLE, wrap="clamp", **system_options):
    system = TextureSystem(gl, **system_options)
    rendered = render_texture(gl, zipmap_texture(zipmap_stage(root, wrap)), quad(), view, system, aovs=True)
    stats = system.stats()
    system.release()
    return rendered, stats


@pytest.mark.parametrize("anisotropy", [1.0, 8.0])
@pytest.mark.parametrize("tilt", [0.0, 80.0])
@pytest.mark.parametrize("distance", [0.01, 0.5, 5.0])
def test_zipmap_constant_image_stays_constant(gl, tmp_path, anisotropy, tilt, distance):
    file = constant(tmp_path / "c.tif", (0.25, 0.5, 0.75), (37, 19), dtype="float32", levels=20)
    rendered, _ = frame(
        gl, Patch(file, np.eye(3)), tilted_view((0.5, 0.5), distance, tilt, 60, 40), anisotropy=anisotropy
    )
    seen = rendered[..., 3] > 0
    assert seen.any()
    assert np.abs(rendered[seen][:, :3] - [0.25, 0.5, 0.75]).max() < 1e-3


def test_zipmap_weights_sum_to_one(gl, tmp_path, rng):
    root = constant(tmp_path / "root.tif", (0.5, 0.5, 0.5), dtype="float32")
    texels = np.full((40, 40, 4), 0.5, np.float32)
    texels[..., 3] = rng.random((40, 40))
    texels[..., :3] *= texels[..., 3:]
    file = save(tmp_path / "patch.exr", texels, "float16", levels=20)
    children = tuple(Patch(file, placed((x, 0.1), (x + 0.6, 0.8)), opacity=0.7) for x in (0.0, 0.2, 0.4))
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=children))
    assert np.abs(rendered[..., :3] - 0.5).max() < 2e-3
    assert np.abs(rendered[..., 3] - 1).max() < 2e-3


def test_zipmap_shows_the_mip_level_that_the_footprint_asks_for(gl, tmp_path):
    """A pyramid whose levels are red, green, blue and grey: a fault in the choice of level shows as a wrong colour."""
    ladder = np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1]] + [[0.5, 0.5, 0.5]] * 5)
    levels = [np.broadcast_to(color, (128 >> n, 128 >> n, 3)).copy() for n, color in enumerate(ladder)]
    path = str(tmp_path / "ladder.tif")
    images.write_pyramid(path, levels, "uint8", "raw")
    for level in range(3):
        rendered, _ = frame(
            gl, Patch(path, np.eye(3), color_space="raw"), front_view((0, 0), (1, 1), *(2 * [128 >> level]))
        )
        assert np.abs(rendered[..., :3] - ladder[level]).max() < 0.01
        assert np.abs(rendered[..., 4] - level).max() < 0.01


def test_zipmap_patch_split_in_four_equals_the_whole_within(gl, tmp_path, rng):
    root = constant(tmp_path / "root.tif", (0.2, 0.2, 0.2))
    texels = np.concatenate([rng.random((64, 64, 3)), np.ones((64, 64, 1))], -1).astype(np.float32)
    whole = Patch(save(tmp_path / "whole.tif", texels), np.eye(3))
    quarters = []
    for row in range(2):
        for column in range(2):
            part = texels[32 * row : 32 * row + 32, 32 * column : 32 * column + 32]
            corner = np.array([column / 2, (1 - row) / 2])
            quarters.append(Patch(save(tmp_path / f"{row}{column}.tif", part), placed(corner, corner + 0.5)))
    view = front_view((0.05, 0.05), (0.45, 0.45), 200, 200)
    one, _ = frame(gl, Patch(root, np.eye(3), children=(whole,)), view)
    four, _ = frame(gl, Patch(root, np.eye(3), children=tuple(quarters)), view)
    assert np.abs(one[..., :4] - four[..., :4]).max() < 1e-3


# Far off, the two are filtered on different texel grids: a little of the signal itself is blurred differently.
@pytest.mark.parametrize(("zoom", "tolerance"), [(0.2, 0.02), (0.8, 0.004), (2.5, 0.004), (9.0, 0.004)])
def test_zipmap_crop_of_the_parent_leaves_no_seam(gl, tmp_path, zoom, tolerance):
    """Child = the same smooth signal at four times the resolution: with and without it the picture is the same."""

    def signal(low, high, size):
        s = low + (np.arange(size) + 0.5) / size * (high - low)
        wave = 0.5 + 0.4 * np.sin(9 * s[None, :] + 2) * np.cos(7 * s[:, None])
        return np.repeat(wave[..., None], 3, axis=-1).astype(np.float32)

    root = save(tmp_path / "root.tif", signal(0, 1, 256), "float32", levels=20)
    alpha = np.ones((256, 256, 1), np.float32)
    child = np.concatenate([signal(0.375, 0.625, 256), alpha], -1)
    file = save(tmp_path / "child.tif", child, "float32", levels=20)
    half = 0.5 / zoom
    view = front_view((0.5 - half, 0.5 - half), (0.5 + half, 0.5 + half), 150, 150)
    patch = Patch(file, placed((0.375, 0.375), (0.625, 0.625)))
    with_child, _ = frame(gl, Patch(root, np.eye(3), children=(patch,)), view, "black")
    without, _ = frame(gl, Patch(root, np.eye(3)), view, "black")
    assert np.abs(with_child[..., :3] - without[..., :3]).max() < tolerance


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 40), (3, 3), (37, 5), (65, 129)])
def test_zipmap_patch_of_any_size_is_clear_at_its_border(gl, tmp_path, size):
    """The border texels of every level are transparent, so a patch under 3 texels wide is not seen."""
    root = constant(tmp_path / "root.tif", (0, 0, 0))
    file = constant(tmp_path / "patch.tif", (1, 1, 1, 1), size, levels=20)
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(Patch(file, placed((0.25, 0.25), (0.75, 0.75))),)))
    assert rendered[:15, :, 0].max() == 0
    assert rendered[:, 50:, 0].max() == 0
    assert (rendered[..., 0].max() > 0.9) == (min(size) > 2)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (37, 5)])
def test_zipmap_root_of_any_size_fills_the_view(gl, tmp_path, size):
    root = Patch(constant(tmp_path / "root.tif", (1, 0.5, 0), size), np.eye(3), color_space="raw")
    rendered, _ = frame(gl, root)
    assert np.abs(rendered[..., :4] - [1, 128 / 255, 0, 1]).max() < 1e-3


def test_zipmap_transparent_patch_changes_nothing_and_opaque_patch_hides_all(gl, tmp_path):
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    hidden = constant(tmp_path / "clear.tif", (0, 1, 0, 0))
    opaque = constant(tmp_path / "opaque.tif", (0, 0, 1, 1))
    cover = placed((-0.5, -0.5), (1.5, 1.5))
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(Patch(hidden, cover),)))
    assert np.abs(rendered[..., :3] - [1, 0, 0]).max() < 1e-3
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(Patch(opaque, cover), Patch(opaque, cover, opacity=0.0))))
    assert np.abs(rendered[..., :3] - [0, 0, 1]).max() < 1e-3
    assert (rendered[..., 5] == 1).all()


def test_zipmap_mask_replaces_alpha_at_any_resolution(gl, tmp_path):
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    file = constant(tmp_path / "patch.tif", (0, 1, 0), (64, 64))
    mask = constant(tmp_path / "mask.tif", (0.5, 0.5, 0.5), (7, 3))
    patch = Patch(file, placed((-0.5, -0.5), (1.5, 1.5)), mask=mask)
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(patch,)))
    assert np.abs(rendered[20:40, 20:40, :3] - [0.5, 0.5, 0]).max() < 5e-3


def test_zipmap_patch_beyond_the_root_is_seen_on_a_repeating_surface(gl, tmp_path):
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    file = constant(tmp_path / "patch.tif", (0, 1, 0, 1))
    patch = Patch(file, placed((0.9, 0.9), (1.4, 1.4)))
    system = TextureSystem(gl)
    texture = zipmap_texture(zipmap_stage(Patch(root, np.eye(3), children=(patch,)), "repeat"))
    rendered = render_texture(gl, texture, quad((0, 0), (2, 2)), WHOLE, system)
    system.release()
    assert np.abs(rendered[64 - 36, 36, :3] - [0, 1, 0]).max() < 1e-3
    assert np.abs(rendered[64 - 5, 5, :3] - [1, 0, 0]).max() < 1e-3


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((3, 3)), np.ones((3, 3)), np.full((3, 3), np.nan), np.diag([1, 1, np.inf]), np.diag([1.0, 0, 1])],
)
def test_zipmap_unusable_matrix_warns_once_and_hides_the_patch(gl, tmp_path, matrix):
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    patch = Patch(constant(tmp_path / "patch.tif", (0, 1, 0, 1)), matrix)
    with pytest.warns(FexelWarning, match=r"/Zipmap/patch0\.inputs:matrix") as caught:
        rendered, _ = frame(gl, Patch(root, np.eye(3), children=(patch,)))
    assert len(caught) == 1
    assert np.abs(rendered[..., :3] - [1, 0, 0]).max() < 1e-3


def test_zipmap_mirrored_patch_is_mirrored(gl, tmp_path):
    texels = np.zeros((32, 32, 4), np.float32)
    texels[:, :16, 0] = texels[:, 16:, 1] = texels[..., 3] = 1
    root = constant(tmp_path / "root.tif", (0, 0, 0))
    mirrored = homography.translate(-1, 0) @ homography.scale(-1, 1)
    patch = Patch(save(tmp_path / "patch.tif", texels), mirrored)
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(patch,)))
    assert rendered[32, 12, 1] > 0.99
    assert rendered[32, 52, 0] > 0.99


def test_zipmap_patch_ends_where_its_horizon_crosses_the_view(gl, tmp_path):
    """w falls to zero inside the view: transparent at and behind infinity, finite everywhere."""
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    file = constant(tmp_path / "patch.tif", (0, 1, 0, 1), (64, 64), levels=20)
    # The patch's line at infinity is t = 0.6 of its parent; the patch lies below.
    matrix = np.array([[1.0, 0, 0], [0, 1, -1 / 0.6], [0, 0, 1]])
    rendered, _ = frame(gl, Patch(root, np.eye(3), children=(Patch(file, matrix),)), anisotropy=8.0)
    assert np.isfinite(rendered).all()
    assert np.abs(rendered[:25, :, :3] - [1, 0, 0]).max() < 1e-3
    assert rendered[-10, 5, 1] > 0.9


def test_zipmap_grazing_view_is_finite_and_filtered_to_the_mean(gl, tmp_path):
    checker = np.indices((256, 256)).sum(axis=0) % 2
    file = save(tmp_path / "checker.tif", np.repeat(checker[..., None], 3, -1).astype(np.float32), "float32", levels=20)
    rendered, _ = frame(gl, Patch(file, np.eye(3)), tilted_view((0.5, 0.5), 3.0, 87.0, 96, 64), anisotropy=16.0)
    seen = rendered[..., 3] > 0.999
    assert np.isfinite(rendered).all()
    assert np.abs(rendered[seen][:, :3] - 0.5).max() < 0.2
    assert abs(rendered[seen][:, :3].mean() - 0.5) < 0.02


def test_zipmap_missing_file_warns_once_and_shows_the_fallback(gl, tmp_path):
    missing = Patch(str(tmp_path / "missing.png"), np.eye(3))
    stage = zipmap_stage(missing)
    stage.GetPrimAtPath("/Zipmap").CreateAttribute("inputs:fallback", Sdf.ValueTypeNames.Float4).Set(
        Gf.Vec4f(0, 0.5, 1, 1)
    )
    system = TextureSystem(gl)
    with pytest.warns(FexelWarning, match=r"/Zipmap\.inputs:file: .*missing\.png: no such file") as caught:
        rendered = [render_texture(gl, zipmap_texture(stage), quad(), WHOLE, system) for _ in range(2)]
    system.release()
    assert len(caught) == 1
    assert np.abs(np.array(rendered)[..., :4] - [0, 0.5, 1, 1]).max() < 1e-3


def test_zipmap_truncated_file_warns_and_leaves_the_parent_to_be_seen(gl, tmp_path, rng):
    root = constant(tmp_path / "root.tif", (1, 0, 0))
    file = save(tmp_path / "patch.tif", rng.random((200, 200, 4)).astype(np.float32))
    with open(file, "r+b") as handle:
        handle.truncate(20_000)
    patch = Patch(file, placed((0.1, 0.1), (0.9, 0.9)))
    with pytest.warns(FexelWarning, match=r"/Zipmap/patch0\.inputs:file"):
        rendered, _ = frame(gl, Patch(root, np.eye(3), children=(patch,)))
    assert np.abs(rendered[..., :3] - [1, 0, 0]).max() < 1e-3


def test_zipmap_exr_with_nan_and_infinity_renders_finite(gl, tmp_path):
    texels = np.full((32, 32, 4), 0.5, np.float32)
    texels[..., 3] = 1
    texels[4:8, 4:8, 0] = np.nan
    texels[12:16, 4:8, 1] = np.inf
    texels[20:24, 4:8, 3] = np.nan
    path = str(tmp_path / "bad.exr")
    images.write_pyramid(path, [texels], "float32", "raw")
    rendered, _ = frame(gl, Patch(path, np.eye(3)))
    assert np.isfinite(rendered).all()


def test_zipmap_file_name_with_shader_source_is_only_a_name(gl, tmp_path):
    name = "a; } void main() { discard; } #define zipmap_sample 0 //.tif"
    file = constant(tmp_path / name.replace("/", ""), (0, 1, 0))
    rendered, _ = frame(gl, Patch(file, np.eye(3)))
    assert np.abs(rendered[..., :3] - [0, 1, 0]).max() < 1e-3


def test_zipmap_image_placed_many_times_is_stored_once(gl, tmp_path):
    root = constant(tmp_path / "root.tif", (0, 0, 0))
    file = constant(tmp_path / "patch.tif", (0, 1, 0, 1))
    children = tuple(Patch(file, placed((n / 10, 0), (n / 10 + 0.08, 1))) for n in range(10))
    _, stats = frame(gl, Patch(root, np.eye(3), children=children))
    assert stats["patches_total"] == stats["patches_seen"] == 11
    assert stats["images_resident"] == 2


def test_zipmap_loads_only_what_the_view_sees(gl, tmp_path):
    """One patch in view of 400: its file and the root's are opened, and no other exists."""
    root = constant(tmp_path / "root.tif", (0, 0, 0), (512, 512), levels=20)
    seen = constant(tmp_path / "seen.tif", (0, 1, 0, 1))
    children = tuple(
        Patch(
            seen if n == 210 else str(tmp_path / f"absent{n}.tif"),
            placed((n % 20 / 20, n // 20 / 20), ((n % 20 + 1) / 20, (n // 20 + 1) / 20)),
        )
        for n in range(400)
    )
    view = front_view((0.51, 0.51), (0.54, 0.54), 64, 64)
    rendered, stats = frame(gl, Patch(root, np.eye(3), children=children), view)
    assert rendered[32, 32, 1] > 0.99
    assert stats["patches_total"] == 401
    assert stats["patches_seen"] == stats["images_resident"] == 2
    assert stats["texture_bytes"] < 200_000


def test_zipmap_past_the_budget_shows_coarser_levels_and_warns_once(gl, tmp_path, rng):
    texels = mipmaps.pyramid(rng.random((32, 32, 3)).astype(np.float32))[0].repeat(16, 0).repeat(16, 1)
    file = save(tmp_path / "root.tif", texels, levels=20)
    view = front_view((0, 0), (1, 1), 512, 512)
    full, stats = frame(gl, Patch(file, np.eye(3), color_space="raw"), view)
    with pytest.warns(FexelWarning, match="texture memory") as caught:
        small, small_stats = frame(gl, Patch(file, np.eye(3), color_space="raw"), view, memory_mb=0.1)
    assert len(caught) == 1
    assert small_stats["dropped_levels"] > 0 == stats["dropped_levels"]
    assert small_stats["texture_bytes"] <= 0.1 * 2**20 * 1.5
    assert np.abs(small[8::16, 8::16, :3] - full[8::16, 8::16, :3]).mean() < 0.1


def test_zipmap_nest_of_twelve_is_seen_at_every_depth(gl, tmp_path):
    colors = [(n / 12, 1 - n / 12, 0.5, 1.0) for n in range(13)]
    patch = None
    for depth in range(12, 0, -1):
        file = constant(tmp_path / f"{depth}.tif", colors[depth], dtype="float32")
        patch = Patch(file, placed((0.3, 0.4), (0.55, 0.65)), children=() if patch is None else (patch,))
    root = Patch(constant(tmp_path / "root.tif", colors[0], dtype="float32"), np.eye(3), children=(patch,))
    texture = zipmap_texture(zipmap_stage(root))
    system = TextureSystem(gl)
    for depth in (1, 6, 12):
        to_st = homography.invert(texture.data.root_to_patch[depth])
        low, high = homography.apply(to_st, np.array([[0.7, 0.7], [0.8, 0.8]]))
        rendered = render_texture(gl, texture, quad(), front_view(low, high, 16, 16), system)
        assert np.abs(rendered[..., :3] - colors[depth][:3]).max() < 2e-3
    system.release()
