"""The seam measure sees what is added at a border and nothing else; the authoring chain adds next to nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fexel_tools.blend_mask import blend_mask
from fexel_tools.color_match import match_color
from fexel_tools.poisson import clone, detailed_border, ring_of
from fexel_tools.seam import outline_points, seam_steps
from fexel_tools.texture_files import encode

SQUARE = np.array([[40, 30], [120, 30], [120, 90], [40, 90]], np.float64)


@pytest.fixture
def scene(rng):
    image = sum(cv2.GaussianBlur(rng.normal(size=(128, 176, 3)), (0, 0), s) * s for s in (1.5, 4, 12))
    return (0.1 + 0.7 * (image - image.min()) / np.ptp(image)).astype(np.float32)


def test_truth_itself_has_no_seam(scene):
    assert np.abs(seam_steps(scene, scene, SQUARE)).max() == 0


def test_step_is_the_colour_difference_that_was_added():
    grey = np.full((128, 176, 3), 0.18)
    pasted = grey.copy()
    pasted[30:90, 40:120] = 0.2
    steps = seam_steps(pasted, grey, SQUARE)
    assert len(steps) == pytest.approx(2 * (76 + 56), abs=4)
    assert steps.std() < 1e-6
    assert 1.5 < steps.mean() < 2.5  # L* 49.5 to 51.8, lightness weight near 1


def test_an_edge_of_the_motif_that_lies_on_the_border_counts_for_nothing(scene):
    scene[30:90, 40:120] *= 0.5
    assert np.abs(seam_steps(scene, scene * 0.999, SQUARE)).max() < 0.1


@pytest.mark.parametrize("flip", [1, -1])
def test_points_lie_on_their_own_side(flip):
    inner, outer = outline_points(SQUARE[::flip], 1.0)
    assert ((inner > (40, 30)) & (inner < (120, 90))).all()
    assert not ((outer > (40, 30)) & (outer < (120, 90))).all(axis=1).any()
    assert np.allclose(np.linalg.norm(inner - outer, axis=1), 2)


def test_patch_outside_the_picture_or_too_small_has_no_points(scene):
    assert seam_steps(scene, scene, SQUARE + 1000).shape == (0,)
    assert seam_steps(scene, scene, SQUARE[:1].repeat(4, axis=0)).shape == (0,)


def test_matched_cloned_and_masked_child_leaves_no_seam(scene):
    """Exposure, white balance and a gradient of light are gone; pasted as it is the child shows a step of over 5."""
    part = (slice(30, 90), slice(40, 120))
    light = np.linspace(0.85, 1.1, 80, dtype=np.float32)[:, None]
    child = np.clip(scene[part] * light / np.array([1.5, 1.2, 0.9], np.float32), 0, 1)
    placed = np.array([[1, 0, 40], [0, 1, 30], [0, 0, 1.0]])
    matched = match_color(child, scene, placed).apply(child)
    solved = clone(matched, detailed_border(matched, ring_of(scene[part]), 1.0))
    alpha = blend_mask(encode(np.maximum(solved, 0), None, "uint8", "sRGB")).alpha[..., None]
    composite, pasted = scene.copy(), scene.copy()
    composite[part] = alpha * solved + (1 - alpha) * scene[part]
    pasted[part] = child
    steps = seam_steps(composite, scene, SQUARE)
    assert steps.mean() <= 0.5
    assert np.percentile(steps, 99) <= 2
    assert seam_steps(pasted, scene, SQUARE).mean() > 5
    assert np.abs(composite - scene).mean() < 0.01
