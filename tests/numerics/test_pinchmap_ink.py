"""Solid lines are drawn at the discontinuities, and nowhere else."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from fexel.textures.pinchmap_twin import edge, pinch
from fexel_tools.pinchmap_fit import fit
from fexel_tools.pinchmap_ink import clear_of_lines
from fexel_tools.pinchmap_mask import channels

SIZE, WIDTH = 24, 0.4


@pytest.fixture(scope="module")
def star():
    """The map fitted to a star, whose tips push gamma to its limits."""
    angle = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    radius = np.where(np.arange(10) % 2, 100, 220)
    points = 256 + radius[:, None] * np.stack([np.sin(angle), -np.cos(angle)], 1)
    side = cv2.fillPoly(np.zeros((512, 512), np.uint8), [np.rint(points).astype(np.int32)], 255, cv2.LINE_AA)
    return fit(side / np.float32(255), (SIZE, SIZE)).pinchmap


def specks(pinchmap: np.ndarray) -> int:
    """Connected pieces of ink without a discontinuity in or beside them."""
    pixels = 768
    middle = (np.arange(pixels) + 0.5) / pixels
    st = np.stack(np.meshgrid(middle, 1 - middle), -1).reshape(-1, 2)
    jacobian = np.diag([1 / pixels, -1 / pixels])
    ink = (
        pinch(pinchmap, st, 0.5, jacobian=jacobian, antialias=1.0, line_width=WIDTH).line.reshape(pixels, pixels) > 0.5
    )
    side = (edge(pinchmap, st) > 0).reshape(pixels, pixels).astype(np.uint8)
    boundary = cv2.dilate(side, np.ones((5, 5))) != cv2.erode(side, np.ones((5, 5)))
    count, labels = cv2.connectedComponents(ink.astype(np.uint8))
    return sum(not boundary[labels == label].any() for label in range(1, count))


def test_no_ink_apart_from_the_discontinuities(star):
    assert specks(clear_of_lines(star, WIDTH)) == 0


def test_gamma_near_k_beside_an_edge_makes_a_speck_until_it_is_cleared():
    """A straight edge, moved left by gamma of its texels; on its right one texel whose gamma comes near to k."""
    mask = np.tile(np.arange(8) >= 4, (8, 1))
    pinchmap = np.dstack([channels(mask), np.zeros(mask.shape)])
    pinchmap[:, 4, 3] = -0.8
    pinchmap[4, 5, 3] = 0.98
    assert specks(pinchmap) == 1
    assert specks(clear_of_lines(pinchmap, WIDTH)) == 0


def test_boundary_stays_where_it_was_but_for_sharp_corners(star):
    cleared = clear_of_lines(star, WIDTH)
    middle = (np.arange(512) + 0.5) / 512
    st = np.stack(np.meshgrid(middle, 1 - middle), -1).reshape(-1, 2)
    moved = (edge(cleared, st) > 0) != (edge(star, st) > 0)
    assert moved.mean() < 0.004


def test_maps_without_lines_are_left_alone(star):
    np.testing.assert_array_equal(clear_of_lines(star, 0.0), star)
