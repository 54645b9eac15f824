"""AOVs of filtering: footprint, fetches, filter, decision; and the filter that a renderer draws all textures with."""

from __future__ import annotations

import json
import warnings

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade
from typer.testing import CliRunner

from fexel.errors import FexelError
from fexel.filters import FILTERS, decision
from fexel.renderer import Renderer
from fexel.renderer.encoding import data_range, visible_data
from fexel.renderer.output import write_images
from fexel.schema.minification import TextureMinificationAPI
from stages import textured_quad, write_image

BLACK = {"diffuseColor": (0.0, 0.0, 0.0), "useSpecularWorkflow": 1}
KINDS = ("UsdUVTexture", "ZipmapTexture", "PinchmapTexture", "UmbrellaTexture")
TEXTURE = "/World/Material/emissiveColor"
SIZE = (24, 10)  # of the image; width, height
PROJECTIVE = np.array([[1.1, 0.2, 0.3], [-0.3, 0.8, -0.2], [0.1, 0.05, 1.0]])  # row vectors
AFFINE = np.array([[0.9, -0.4, 0.0], [0.3, 1.2, 0.0], [0.2, 0.1, 1.0]])


def textured(tmp_path, rng, kind="UsdUVTexture", *, st=None, matrix=None, filter=None):
    """A quad of 2 x 2 with a texture of this kind, seen by an orthographic camera that it fills."""
    width, height = SIZE
    file = f"./{write_image(tmp_path / 'image.png', rng.integers(0, 256, (height, width, 3), dtype=np.uint8)).name}"
    stage = textured_quad(tmp_path / "quad.usda", {"emissiveColor": (file, "rgb", {"wrapS": "repeat"})}, **BLACK)
    prim = stage.GetPrimAtPath(TEXTURE)
    if kind != "UsdUVTexture":
        stage.RemovePrim(TEXTURE)
        prim = stage.DefinePrim(TEXTURE, kind)
        prim.GetAttribute("inputs:file").Set(Sdf.AssetPath(file))
        for name in ("wrapS", "wrapT"):
            prim.GetAttribute(f"inputs:{name}").Set("repeat")
        surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface"))
        surface.GetInput("emissiveColor").ConnectToSource(Sdf.Path(f"{TEXTURE}.outputs:rgb"))
    if matrix is not None:
        prim.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(*map(float, matrix.ravel())))
    if st is not None:
        UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Quad")).GetPrimvar("st").Set([Gf.Vec2f(*row) for row in st])
    if filter is not None:
        TextureMinificationAPI.Apply(prim).GetPrim().GetAttribute("minification:filter").Set(filter)
    return stage


def look_askew(stage, slope=2.0):
    """Perspective, onto a quad that recedes."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Quad"))
    mesh.GetPointsAttr().Set([Gf.Vec3f(x, y, -slope * y) for x, y in [(-1, -1), (1, -1), (1, 1), (-1, 1)]])
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetProjectionAttr().Set("perspective")
    camera.CreateFocalLengthAttr(40.0)  # half the picture at distance 1: 0.25
    return stage


def places(px, py, size, slope=2.0):
    """Where rays through pixels of a square picture meet the receding quad: (..., 2) x, y."""
    x, y = 0.25 * (2 * px / size - 1), 0.25 * (1 - 2 * py / size)
    distance = 5.0 / (1 - slope * y)  # z = 5 - d = -slope y d
    return np.stack([x * distance, y * distance], axis=-1)


def mapped(st, matrix):
    result = np.concatenate([st, np.ones_like(st[..., :1])], axis=-1) @ matrix
    return result[..., :2] / result[..., 2:]


def ellipse(jacobian):
    """(..., 3): axes and angle of the major one by SVD."""
    u, axes, _ = np.linalg.svd(jacobian)
    return np.concatenate([axes, np.mod(np.arctan2(u[..., 1, 0], u[..., 0, 0]), np.pi)[..., None]], axis=-1)


def assert_same_ellipse(found, wanted, tolerance):
    np.testing.assert_allclose(found[..., :2], wanted[..., :2], rtol=tolerance)
    turned = np.abs(np.mod(found[..., 2] - wanted[..., 2] + np.pi / 2, np.pi) - np.pi / 2)
    assert turned.max() < tolerance and (found[..., 2] >= 0).all() and (found[..., 2] < np.pi).all()


@pytest.mark.parametrize("kind", KINDS)
def test_footprint_of_an_affine_view_is_the_ellipse_of_its_jacobian(renderer, tmp_path, rng, kind):
    st = np.array([[0.0, 0.0], [5.0, 1.5], [4.0, 8.5], [-1.0, 7.0]])  # a parallelogram
    matrix = AFFINE if kind != "UsdUVTexture" else np.eye(3)
    stage = textured(tmp_path, rng, kind, st=st, matrix=None if kind == "UsdUVTexture" else matrix)
    found = renderer.render(stage, width=16, height=16, aovs=("footprint",))["footprint"]
    per_pixel = np.stack([st[1] - st[0], st[0] - st[3]], axis=1) / 16  # columns: right, down
    wanted = ellipse(np.diag(SIZE) @ matrix[:2, :2].T @ per_pixel)
    assert wanted[0] > 1.3 * wanted[1]
    assert_same_ellipse(found, np.broadcast_to(wanted, found.shape), 1e-4)


@pytest.mark.parametrize("filter", [None, "mipmap"])
@pytest.mark.parametrize("kind", KINDS)
def test_footprint_of_a_projective_view_and_map_follows_from_pixel_to_pixel(renderer, tmp_path, rng, kind, filter):
    matrix = PROJECTIVE if kind != "UsdUVTexture" else np.eye(3)
    stage = textured(tmp_path, rng, kind, matrix=None if kind == "UsdUVTexture" else matrix, filter=filter)
    found = renderer.render(look_askew(stage), width=64, height=64, aovs=("footprint", "primId"))
    seen = found["primId"][..., 0] >= 0
    py, px = (np.argwhere(seen) + 0.5).T
    step = 1e-3
    texels = [
        mapped(places(px + dx, py + dy, 64) / 2 + 0.5, matrix) * SIZE
        for dx, dy in [(step, 0), (-step, 0), (0, step), (0, -step)]
    ]
    jacobian = np.stack([texels[0] - texels[1], texels[2] - texels[3]], axis=-1) / (2 * step)
    # A quad of pixels shares one difference: half a pixel off, over which a footprint changes by so much.
    assert_same_ellipse(found["footprint"][seen], ellipse(jacobian), 0.06)
    assert np.median(np.abs(found["footprint"][seen][:, 0] / ellipse(jacobian)[:, 0] - 1)) < 0.02
    assert (found["footprint"][~seen] == 0).all()


def test_footprint_of_a_constant_st_and_of_no_texture_is_zero(renderer, tmp_path, rng):
    flat = textured(tmp_path, rng, st=np.full((4, 2), 0.5))
    assert (renderer.render(flat, width=8, aovs=("footprint",))["footprint"] == 0).all()
    (tmp_path / "plain").mkdir()
    plain = textured_quad(tmp_path / "plain" / "quad.usda", {}, diffuseColor=(1.0, 1.0, 1.0))
    images = renderer.render(plain, width=8, aovs=("footprint", "fetches", "filter"))
    assert (images["footprint"] == 0).all() and (images["fetches"] == 0).all() and (images["filter"] == -1).all()


def test_footprint_in_a_deep_zoom_has_its_digits(tmp_path, rng):
    stage = textured(tmp_path, rng)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(0.123456, 0.654321, 5))
    camera.GetHorizontalApertureAttr().Set(2e-5)  # a millionth of the quad
    camera.GetVerticalApertureAttr().Set(2e-5)
    with Renderer() as renderer:
        found = renderer.render(stage, width=16, height=16, aovs=("footprint",))["footprint"]
        assert renderer.stats()["rebasedDraws"] == 1
    pixel = 2e-6 / 16 / 2  # st per pixel
    assert_same_ellipse(found, np.broadcast_to([SIZE[0] * pixel, SIZE[1] * pixel, 0.0], found.shape), 1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_filter_tells_what_the_prim_asks_for_else_anisotropic(renderer, tmp_path, rng, kind):
    for asked, drawn in ((None, "anisotropic"), ("anisotropic", "anisotropic"), ("mipmap", "mipmap")):
        (folder := tmp_path / str(asked)).mkdir()
        stage = textured(folder, rng, kind, filter=asked, st=6 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
        images = renderer.render(stage, width=8, aovs=("filter", "fetches"))
        assert (images["filter"] == FILTERS.index(drawn)).all()
        assert (images["fetches"] >= 4).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("filter", FILTERS)
def test_renderer_draws_every_texture_with_its_own_filter(tmp_path, rng, kind, filter):
    stage = look_askew(
        textured(tmp_path, rng, kind, filter="mipmap", st=9 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    )
    with Renderer(filter=filter) as renderer:
        images = renderer.render(stage, width=32, height=32, aovs=("filter", "fetches", "primId"))
        stats = renderer.stats()["textures"]
    seen = images["primId"] >= 0
    codes = set(images["filter"][seen].astype(int))
    portable = {FILTERS.index(name) for name in ("mipmap", "anisotropic", "ripmap", "fipmap")}
    assert codes == {FILTERS.index(filter)} if filter != "auto" else codes <= portable
    assert (images["fetches"][seen] >= 4).all() and (images["filter"][~seen] == -1).all()
    assert stats["filters"] == {filter: 1}
    json.dumps(stats)


@pytest.mark.parametrize("filter", ["ripmap", "fipmap", "auto"])
@pytest.mark.parametrize("kind", ["UsdUVTexture", "PinchmapTexture"])
def test_filter_that_had_no_room_is_not_told_of(tmp_path, rng, kind, filter):
    stage = look_askew(textured(tmp_path, rng, kind))
    write_image(tmp_path / "image.png", rng.integers(0, 256, (1024, 1024, 3), dtype=np.uint8))
    with Renderer(filter=filter, texture_memory_mb=0.25) as renderer:
        with warnings.catch_warnings(record=True) as warned:  # that coarser levels are shown, too
            warnings.simplefilter("always")
            images = renderer.render(stage, width=64, height=64, aovs=("filter", "primId"))
        assert any(f"no room for its {filter}; anisotropic is shown" in str(each.message) for each in warned)
        assert renderer.stats()["textures"]["filters"] == {"anisotropic": 1}
    seen = images["primId"] >= 0
    assert seen.sum() > 100 and (images["filter"][seen] == FILTERS.index("anisotropic")).all()


@pytest.mark.parametrize("own", ["mipmap", "anisotropic", None])
@pytest.mark.parametrize("outer", ["mipmap", "anisotropic", "ripmap", "fipmap"])
def test_filter_is_that_of_the_patch_on_top(renderer, tmp_path, rng, outer, own):
    stage = look_askew(textured(tmp_path, rng, "ZipmapTexture", filter=outer))
    patch = stage.DefinePrim(f"{TEXTURE}/Patch", "ZipmapTexture")
    pixels = rng.integers(0, 256, (300, 300, 3), dtype=np.uint8)
    patch.GetAttribute("inputs:file").Set(Sdf.AssetPath(f"./{write_image(tmp_path / 'patch.png', pixels).name}"))
    patch.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(2, 0, 0, 0, 2, 0, -0.5, -0.5, 1))
    if own is not None:
        TextureMinificationAPI.Apply(patch).GetPrim().GetAttribute("minification:filter").Set(own)
    images = renderer.render(stage, width=48, height=48, aovs=("filter", "patch", "fetches"))
    on_patch = images["patch"] == 1
    assert on_patch.sum() > 50 and (images["patch"] == 0).sum() > 50
    assert (images["filter"][on_patch] == FILTERS.index(own or outer)).all()
    # Where a footprint is small every filter is bilinear, which is what the root's is called there.
    assert set(np.unique(images["filter"][images["patch"] == 0])) <= {FILTERS.index(outer), 0, 1}
    assert images["fetches"][on_patch].min() >= 4


@pytest.mark.parametrize("kind", ["PinchmapTexture", "UmbrellaTexture"])
@pytest.mark.parametrize(
    ("outer", "own"), [("fipmap", "mipmap"), ("mipmap", "fipmap"), (None, "ripmap"), ("ripmap", None)]
)
def test_filter_is_that_of_a_patch_of_another_kind(renderer, tmp_path, rng, kind, outer, own):
    stage = look_askew(textured(tmp_path, rng, "ZipmapTexture", filter=outer))
    patch = stage.DefinePrim(f"{TEXTURE}/Patch", kind)
    pixels = rng.integers(0, 256, (300, 300, 3), dtype=np.uint8)
    patch.GetAttribute("inputs:file").Set(Sdf.AssetPath(f"./{write_image(tmp_path / 'patch.png', pixels).name}"))
    patch.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(2, 0, 0, 0, 2, 0, -0.5, -0.5, 1))
    if own is not None:
        TextureMinificationAPI.Apply(patch).GetPrim().GetAttribute("minification:filter").Set(own)
    images = renderer.render(stage, width=48, height=48, aovs=("filter", "patch"))
    on_patch = images["patch"] == 1
    assert on_patch.sum() > 50
    assert (images["filter"][on_patch] == FILTERS.index(own or outer)).all()


def test_trilinear_lookup_fetches_eight_texels(renderer, tmp_path, rng):
    stage = textured(tmp_path, rng, filter="mipmap", st=[3, 7] * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    assert (renderer.render(stage, width=16, height=16, aovs=("fetches",))["fetches"] == 8).all()


@pytest.mark.parametrize("accesses", [4, 8, 16])
def test_fipmap_takes_the_accesses_that_the_renderer_is_given(tmp_path, rng, accesses):
    stage = look_askew(textured(tmp_path, rng, st=9 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])))
    with Renderer(filter="fipmap", fipmap_accesses=accesses) as renderer:
        images = renderer.render(stage, width=16, height=16, aovs=("fetches", "primId"))
    assert (images["fetches"][images["primId"] >= 0] == 4 * accesses).all()


def test_accesses_are_those_of_boxes():
    with pytest.raises(FexelError, match="fipmap accesses: 8 with the kernel gauss, expected box"):
        Renderer(filter_kernel="gauss", fipmap_accesses=8)
    with pytest.raises(FexelError, match="fipmap accesses: 5, expected one of 4, 6, 8, 12, 16"):
        Renderer(fipmap_accesses=5)


def test_sixteen_probes_fetch_at_most_128_texels(tmp_path, rng):
    stage = textured(tmp_path, rng, st=[1, 50] * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]]))
    with Renderer(anisotropy=16) as renderer:
        fetches = renderer.render(stage, width=16, height=16, aovs=("fetches",))["fetches"]
    assert fetches.max() <= 128 and fetches.min() > 64


def test_decision_is_the_colour_of_the_direction_to_the_camera(renderer, tmp_path, rng):
    stage = look_askew(textured(tmp_path, rng))
    images = renderer.render(stage, width=48, height=48, aovs=("decision", "position", "primId"))
    seen = images["primId"][..., 0] >= 0
    to_camera = np.array([0, 0, 5.0]) - images["position"][seen].astype(np.float64)
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    along_v = np.array([0, 1, -2]) / np.sqrt(5)
    coordinates = np.abs(
        np.stack([to_camera @ along_v, to_camera @ np.cross([1, 0, 0], along_v), to_camera[:, 0]], axis=1)
    )
    found = images["decision"][seen]
    np.testing.assert_allclose(found, coordinates / coordinates.sum(axis=1, keepdims=True), atol=2e-3)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    frame = np.stack([[1, 0, 0], along_v, np.cross([1, 0, 0], along_v)], axis=1)
    twin = decision.color(to_camera, np.broadcast_to(frame, (len(to_camera), 3, 3)))
    np.testing.assert_allclose(found, twin, atol=2e-3)
    assert (images["decision"][~seen] == 0).all()


def test_decision_of_an_orthographic_camera_is_one_direction(renderer, tmp_path, rng):
    stage = textured(tmp_path, rng)
    assert np.abs(renderer.render(stage, width=8, aovs=("decision",))["decision"] - [0, 1, 0]).max() < 1e-6
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/Quad")).AddRotateXOp().Set(-60.0)
    images = renderer.render(stage, width=8, aovs=("decision", "primId"))
    wanted = np.array([np.sqrt(0.75), 0.5, 0.0]) / (0.5 + np.sqrt(0.75))
    np.testing.assert_allclose(images["decision"][images["primId"][..., 0] >= 0] - wanted, 0.0, atol=1e-5)


def test_decision_darkens_with_distance_as_the_texture_fades(renderer, tmp_path, rng):
    stage = look_askew(textured(tmp_path, rng, filter="mipmap"))
    stage.GetPrimAtPath(TEXTURE).GetAttribute("minification:attenuationDistance").Set(3.0)
    images = renderer.render(stage, width=48, height=48, aovs=("decision", "position", "primId"))
    seen = images["primId"][..., 0] >= 0
    distance = np.linalg.norm(np.array([0, 0, 5.0]) - images["position"][seen], axis=1)
    np.testing.assert_allclose(images["decision"][seen].sum(axis=1), np.exp(-distance / 3.0), rtol=1e-3)


def test_aovs_of_filtering_go_together_with_all_others(renderer, tmp_path, rng):
    names = (
        "depth",
        "cameraDepth",
        "normal",
        "Neye",
        "position",
        "st",
        "lod",
        "patch",
        "footprint",
        "fetches",
        "filter",
    )
    stage = textured(tmp_path, rng)
    together = renderer.render(stage, width=8, aovs=(*names, "decision", "primId"))
    alone = {
        name: renderer.render(stage, width=8, aovs=(name,))[name]
        for name in ("footprint", "fetches", "filter", "decision")
    }
    for name, image in alone.items():
        np.testing.assert_array_equal(together[name], image)


def test_aovs_are_visible_in_png_and_whole_in_exr(tmp_path, renderer, rng):
    stage = look_askew(textured(tmp_path, rng))
    images = renderer.render(stage, width=32, height=32, aovs=("footprint", "fetches", "filter", "decision", "primId"))
    seen = images["primId"][..., 0] >= 0
    for name in ("footprint", "fetches", "filter", "decision"):
        shown = visible_data(name, images[name], data_range(name, images[name]))
        assert np.isfinite(shown).all() and shown.min() >= 0 and shown.max() <= 1
        assert (shown[seen].max(axis=-1) > 0).all() and (shown[~seen] == 0).all()
    files = write_images(tmp_path / "out.png", images)
    assert {file.name for file in files} >= {
        f"out.{name}.png" for name in ("footprint", "fetches", "filter", "decision")
    }
    write_images(tmp_path / "out.exr", images)
    names = oiio.ImageInput.open(str(tmp_path / "out.exr")).spec().channelnames
    assert {"footprint.X", "footprint.Z", "fetches.F", "filter.I", "decision.R"} <= set(names)


def test_footprint_turns_once_around_the_hues_in_half_a_turn():
    angle = np.linspace(0, np.pi, 7)
    rows = np.stack([np.full(7, 64.0), np.full(7, 1.0), angle], axis=-1)[None]
    shown = visible_data("footprint", rows, data_range("footprint", rows))[0]
    np.testing.assert_allclose(shown[0], shown[-1], atol=1e-12)
    assert len(np.unique(shown[:-1].round(6), axis=0)) == 6
    grey = visible_data("footprint", np.array([[[2.0, 2.0, 1.0]]]), data_range("footprint", rows))[0, 0]
    assert np.ptp(grey) < 1e-12 and grey[0] > 0


def render_command(*arguments):
    from fexel_tools.cli import app

    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def test_command_draws_with_one_filter_and_tells_what_it_took(tmp_path, rng):
    look_askew(textured(tmp_path, rng, filter="mipmap")).Save()
    stage = tmp_path / "quad.usda"
    aovs = "color,footprint,fetches,filter,decision"
    options = ("-w", 32, "--aov", aovs, "--stats", tmp_path / "stats.json")
    result = render_command(stage, tmp_path / "a.exr", *options, "--filter", "anisotropic", "--anisotropy", 3)
    assert result.exit_code == 0, (result.output, result.exception)
    stats = json.loads((tmp_path / "stats.json").read_text())["textures"]
    assert stats["filters"] == {"anisotropic": 1} and stats["chains_resident"] == 0
    image = oiio.ImageBuf(str(tmp_path / "a.exr"))
    pixels = dict(zip(image.spec().channelnames, np.moveaxis(image.get_pixels(oiio.FLOAT), -1, 0), strict=True))
    assert set(np.unique(pixels["filter.I"])) == {-1.0, 1.0}
    assert pixels["fetches.F"].max() == 24  # three probes
    result = render_command(stage, tmp_path / "b.png", *options)
    assert result.exit_code == 0, (result.output, result.exception)
    assert json.loads((tmp_path / "stats.json").read_text())["textures"]["filters"] == {"mipmap": 1}
    assert len(list(tmp_path.glob("b.*png"))) == 5


def test_command_counts_the_chains_of_a_fipmap(tmp_path, rng):
    st = 40 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    look_askew(textured(tmp_path, rng, st=st), slope=20.0).Save()
    stats = tmp_path / "stats.json"
    result = render_command(
        tmp_path / "quad.usda", tmp_path / "a.png", "-w", 64, "--filter", "fipmap", "--stats", stats
    )
    assert result.exit_code == 0, (result.output, result.exception)
    textures = json.loads(stats.read_text())["textures"]
    assert textures["filters"] == {"fipmap": 1} and 0 < textures["chains_resident"] < textures["images_resident"]
    assert 0 < textures["chain_bytes"] < textures["texture_bytes"]


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--filter", "cubic", "filter: 'cubic', expected one of mipmap, anisotropic, ripmap, fipmap, ewa, auto"),
        ("--anisotropy", "32", "anisotropy: 32, expected 1 to 16"),
        ("--fipmapAccesses", "5", "fipmap accesses: 5, expected one of 4, 6, 8, 12, 16"),
    ],
)
def test_command_refuses_what_there_is_not_in_one_line(tmp_path, rng, option, value, message):
    textured(tmp_path, rng).Save()
    result = render_command(tmp_path / "quad.usda", tmp_path / "a.png", option, value)
    assert isinstance(result.exception, FexelError) and str(result.exception) == message
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize("filter", ["ripmap", "fipmap"])
def test_patch_that_is_too_small_to_be_seen_needs_nothing(tmp_path, rng, filter):
    stage = textured(tmp_path, rng, "ZipmapTexture")
    patch = stage.DefinePrim(f"{TEXTURE}/Patch", "ZipmapTexture")
    patch.GetAttribute("inputs:file").Set(Sdf.AssetPath("./image.png"))
    patch.GetAttribute("inputs:matrix").Set(Gf.Matrix3d(5000, 0, 0, 0, 5000, 0, -2500, -2500, 1))
    with Renderer(filter=filter) as renderer:
        images = renderer.render(stage, width=16, height=16, aovs=("filter", "patch"))
    assert (images["filter"] == FILTERS.index(filter)).all() and (images["patch"] == 0).all()


def test_kernel_changes_fipmaps_and_nothing_else(tmp_path, rng):
    stage = look_askew(textured(tmp_path, rng, st=12 * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])))
    pictures, fetches = {}, {}
    for token in ("fipmap", "anisotropic"):
        for kernel in ("box", "gauss"):
            with Renderer(filter=token, filter_kernel=kernel) as renderer:
                images = renderer.render(stage, width=64, height=64, samples=1, aovs=("color", "fetches"))
            pictures[token, kernel], fetches[token, kernel] = images["color"], images["fetches"].max()
    assert (fetches["fipmap", "box"], fetches["fipmap", "gauss"]) == (16, 20)
    assert np.abs(pictures["fipmap", "gauss"] - pictures["fipmap", "box"]).max() > 1e-3
    np.testing.assert_array_equal(pictures["anisotropic", "gauss"], pictures["anisotropic", "box"])
