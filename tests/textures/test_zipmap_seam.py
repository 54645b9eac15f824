"""The border of a patch adds no visible step: CIEDE2000 against brute-force supersampled compositing."""

import numpy as np
import pytest

from bench.zipmap_quality import photo_like
from bench.zipmap_stage import Patch, front_view, lookup_texture, pixel_st, quad, save, zipmap_stage, zipmap_texture
from fexel import homography, images
from fexel.renderer.visible import View
from fexel.textures.system import TextureSystem
from fexel.textures.zipmap_twin import layer_pyramid, sample_zipmap
from fexel_tools.seam import seam_steps

SCALE = 4
PIXELS = 64


def composited(layers, data, view, samples):
    """Eq. (1) at samples x samples places per pixel, each bilinear in the full images, averaged in linear light."""
    fine = View(view.world_to_clip, view.width * samples, view.height * samples)
    st = pixel_st(fine)[0]
    pyramids = [layer_pyramid(layer, number > 0)[:1] for number, layer in enumerate(layers)]
    color = sample_zipmap(pyramids, data.root_to_patch, data.opacity, st, np.zeros((len(st), 2, 2)))
    return color.reshape(view.height, samples, view.width, samples, 4).mean(axis=(1, 3))


@pytest.mark.parametrize("px_per_root_texel", [0.5, 1.0, 1.7, 4.0, 12.0])
def test_crop_of_a_high_resolution_image_adds_no_step_at_its_border(gl, tmp_path, rng, px_per_root_texel):
    """The root is the image, area-averaged to a quarter of its resolution; the child a crop of it as it is."""
    image = images.srgb_to_linear(photo_like(rng, 1024))
    size = len(image) // SCALE
    root = image.reshape(size, SCALE, size, SCALE, 3).mean(axis=(1, 3))
    crop = image[256:768, 256:768]
    layers = [np.concatenate([part, np.ones((*part.shape[:2], 1), np.float32)], -1) for part in (root, crop)]
    files = [save(tmp_path / f"{number}.exr", layer, "float32") for number, layer in enumerate(layers)]
    patch = Patch(files[1], homography.translate(-0.25, -0.25) @ homography.scale(2, 2), color_space="raw")
    texture = zipmap_texture(zipmap_stage(Patch(files[0], np.eye(3), children=(patch,), color_space="raw")))
    # A corner of the patch; not on the root's texel grid.
    half = PIXELS / 2 / (size * px_per_root_texel)
    centre = np.clip(np.array([0.2513, 0.2529]), half, None)
    view = front_view(centre - half, centre + half, PIXELS, PIXELS)
    system = TextureSystem(gl, anisotropy=8.0)
    st, jacobian, _ = pixel_st(view)
    rendered = lookup_texture(gl, texture, quad(), view, st, jacobian, system)
    system.release()
    truth = composited(layers, texture.data, view, 8 if px_per_root_texel < 2 else 4)
    corners = (homography.UNIT_SQUARE * 0.5 + 0.25 - (centre - half)) / (2 * half) * PIXELS
    outline = np.stack([corners[:, 0], PIXELS - corners[:, 1]], axis=1)
    steps = seam_steps(rendered[..., :3], truth[..., :3], outline)
    assert len(steps) > PIXELS / 2
    assert steps.mean() <= 0.5
    if px_per_root_texel > 4:  # nearer 1, single steps of this rough image differ by its filtering, border or not
        assert np.percentile(steps, 99) <= 2.0
