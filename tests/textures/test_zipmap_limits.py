"""Past the memory budget or the largest texture, coarser levels are shown, once said; nothing fails."""

import warnings

import numpy as np
import pytest
from pxr import Usd

import fexel
from bench.harness import REPOSITORY
from bench.zipmap_stage import Patch, front_view, quad, render_texture, save, zipmap_stage, zipmap_texture
from fexel import homography
from fexel.errors import FexelWarning
from fexel.textures.atlas import PageAtlas
from fexel.textures.system import TextureSystem


def limited_system(gl, largest):
    """A system as on a GPU whose textures have at most `largest` texels along an axis."""
    system = TextureSystem(gl)
    system.pool.atlases = tuple(PageAtlas(gl, atlas.page_class, largest) for atlas in system.pool.atlases)
    return system


def strip(size):
    """Grey from 0 to 1 along the longer side."""
    ramp = (np.arange(max(size), dtype=np.float32) + 0.5) / max(size)
    along = ramp[None] if size[0] > size[1] else ramp[:, None]
    return np.repeat(np.broadcast_to(along, size[::-1])[..., None], 3, -1)


@pytest.mark.parametrize("largest", [16384, 700])
@pytest.mark.parametrize("size", [(20000, 3), (3, 20000)])
def test_limits_image_longer_than_a_texture_is_shown_coarser(gl, tmp_path, size, largest):
    """Seen whole at 12,000 pixels, so that level 0 is asked for over its whole length."""
    texture = zipmap_texture(
        zipmap_stage(Patch(save(tmp_path / "long.tif", strip(size)), np.eye(3), color_space="raw"))
    )
    system = limited_system(gl, largest)
    shape = (12000, 2) if size[0] > size[1] else (2, 12000)
    with pytest.warns(FexelWarning, match="coarser ones are shown") as caught:
        frames = [render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), *shape), system) for _ in range(2)]
    biggest = max(max(atlas.size) for atlas in system.pool.atlases)
    system.release()
    shown = frames[1][1, :, 0] if size[0] > size[1] else frames[1][:, 1, 0]
    assert len(caught) == 1
    assert biggest <= largest
    texel = largest / 2  # at least so many texels along the strip are left
    assert np.abs(shown - (np.arange(12000) + 0.5) / 12000).max() < 1 / 255 + 1 / texel


def test_limits_many_images_share_a_page_that_is_too_small(gl, tmp_path, rng):
    """Each alone would fit; together they do not, whatever the memory budget."""
    children = []
    for number in range(16):
        texels = np.ones((120, 120, 4), np.float32)
        texels[..., :3] = (number + 1) / 16
        low = np.array([number % 4, number // 4]) / 4
        matrix = homography.translate(*-low) @ homography.scale(4, 4)
        children.append(Patch(save(tmp_path / f"{number}.tif", texels), matrix, color_space="raw"))
    root = save(tmp_path / "root.tif", np.zeros((8, 8, 3), np.float32))
    texture = zipmap_texture(zipmap_stage(Patch(root, np.eye(3), children=tuple(children))))
    system = limited_system(gl, 256)
    with pytest.warns(FexelWarning, match="coarser ones are shown") as caught:
        frame = render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), 480, 480), system)
    assert system.stats()["images_resident"] == 17
    system.release()
    assert len(caught) == 1
    centres = frame[60::120, 60::120, 0][::-1]
    assert np.abs(centres.ravel() - (np.arange(16) + 1) / 16).max() < 1 / 255


@pytest.mark.parametrize("budget_mb", [0.25, 0.5, 1.0, 3.0])
def test_limits_pages_stay_within_the_budget_whatever_was_seen_before(gl, tmp_path, rng, budget_mb):
    """Images of many shapes, in 8 bits, then in half floats: what one view needed makes way for the next."""
    system = TextureSystem(gl, memory_mb=budget_mb)
    granule = 64 * 64 * 8  # the smallest page of half floats
    resident = []
    for dtype in ("uint8", "float16", "uint8"):
        folder = tmp_path / f"{dtype}{len(resident)}"
        folder.mkdir()
        name = "{}.exr" if dtype == "float16" else "{}.tif"
        children = []
        for number in range(9):
            texels = np.ones((*rng.integers(90, 400, 2), 4), np.float32)
            low = np.array([number % 3, number // 3]) / 3
            file = save(folder / name.format(number), texels, dtype)
            children.append(Patch(file, homography.translate(*-low) @ homography.scale(3, 3)))
        root = save(folder / name.format("root"), np.zeros((8, 8, 3), np.float32), dtype)
        texture = zipmap_texture(zipmap_stage(Patch(root, np.eye(3), children=tuple(children))))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FexelWarning)
            frame = render_texture(gl, texture, quad(), front_view((0, 0), (1, 1), 900, 900), system)
        assert np.abs(frame[150::300, 150::300, :3] - 1).max() < 1e-3
        resident.append(system.stats()["texture_bytes"])
    system.release()
    assert max(resident) <= budget_mb * 2**20 + granule


@pytest.mark.parametrize("budget_mb", [1e-6, 1.0])
def test_limits_tiny_budget_still_renders_the_teapot(budget_mb):
    stage = Usd.Stage.Open(str(REPOSITORY / "stages/zipmap_teapot/zipmap_teapot.usda"))
    renderer = fexel.Renderer(texture_memory_mb=budget_mb)
    with pytest.warns(FexelWarning, match="texture memory of") as caught:
        frames = [renderer.render(stage, camera="Head", width=256)["color"] for _ in range(2)]
    stats = renderer.stats()
    renderer.close()
    assert len(caught) == 1
    assert np.isfinite(frames[0]).all()
    assert frames[0][..., :3].std() > 0.01
    assert stats["textures"]["dropped_levels"] > 0
