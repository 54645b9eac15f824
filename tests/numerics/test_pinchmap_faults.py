"""Places that a pinchmap cannot follow: found, counted, named."""

import numpy as np

from fexel_tools.pinchmap_faults import find_faults
from fexel_tools.pinchmap_fit import fit

CELL = (20.0, 20.0)


def strokes(angles, width, size=200):
    """Strokes from the centre outward at some angles in degrees, as 0 and 1."""
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    plus = np.zeros((size, size), np.uint8)
    for angle in np.radians(angles):
        along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        plus |= ((along > 0) & (np.abs(across) < width / 2)).astype(np.uint8)
    return plus


def spot(plus, x, y, radius=5):
    """Wrong pixels in a disc."""
    rows, columns = np.ogrid[: plus.shape[0], : plus.shape[1]]
    return (((columns + 0.5 - x) ** 2 + (rows + 0.5 - y) ** 2) < radius**2).astype(np.uint8)


def reason(plus, x=100, y=100, cell=CELL):
    faults = find_faults(plus, spot(plus, x, y), cell)
    assert len(faults) == 1
    return faults[0].reason


def test_nothing_wrong_is_no_fault():
    assert find_faults(np.ones((50, 50), np.uint8), np.zeros((50, 50), np.uint8), CELL) == ()


def test_three_and_four_strokes_that_meet_are_a_junction():
    assert reason(strokes([0, 120, 240], 8)) == "junction"
    assert reason(strokes([10, 100, 190, 280], 8)) == "junction"
    assert reason(1 - strokes([0, 90, 200], 8)) == "junction"


def test_two_edges_through_one_point_cross():
    y, x = np.mgrid[:200, :200] + 0.5 - 100
    assert reason((x * y > 0).astype(np.uint8)) == "crossing"
    assert reason(((x + 0.4 * y) * (y - 0.3 * x) > 0).astype(np.uint8)) == "crossing"


def test_the_two_sides_of_a_stroke_or_gap_are_too_near():
    assert reason(strokes([30, 210], 8)) == "too near"
    assert reason(1 - strokes([30, 210], 8)) == "too near"


def test_a_spot_a_tip_and_a_corner_are_too_small():
    plus = np.zeros((200, 200), np.uint8)
    assert reason(plus | spot(plus, 100, 100, 6)) == "too small"
    assert reason(strokes([45], 6)) == "too small"
    y, x = np.mgrid[:200, :200] + 0.5 - 100
    assert reason(((x > 0) & (y > 0)).astype(np.uint8)) == "too small"


def test_most_wrong_pixels_come_first_and_small_places_are_left_out():
    plus = strokes([30, 210], 8)
    wrong = spot(plus, 40, 150, 4) | spot(plus, 150, 40, 9) | spot(plus, 20, 20, 1.2)
    faults = find_faults(plus, wrong, CELL)
    assert [fault.pixels for fault in faults] == sorted((fault.pixels for fault in faults), reverse=True)
    assert len(faults) == 2
    assert np.hypot(faults[0].x - 150, faults[0].y - 40) < 0.5


def test_wrong_pixels_half_a_texel_apart_are_one_place():
    plus = np.zeros((200, 200), np.uint8)
    assert len(find_faults(plus, spot(plus, 90, 100) | spot(plus, 104, 100), CELL)) == 1
    assert len(find_faults(plus, spot(plus, 70, 100) | spot(plus, 130, 100), CELL)) == 2


def test_a_place_at_the_border_and_a_tiny_image_have_a_reason():
    assert reason(strokes([0, 180], 8), x=3, y=100) == "too near"
    assert find_faults(np.ones((2, 2), np.uint8), np.ones((2, 2), np.uint8), (1.0, 1.0))[0].reason == "too small"


def test_a_fit_reports_the_crossing_that_it_cannot_show():
    y, x = np.mgrid[:320, :320] + 0.5 - 163.0
    side = ((x + 0.2 * y) * (y - 0.3 * x) > 0).astype(np.float32)
    faults = fit(side, (16, 16)).faults
    nearest = min(faults, key=lambda fault: np.hypot(fault.x - 163, fault.y - 163))
    assert np.hypot(nearest.x - 163, nearest.y - 163) < 30
    assert nearest.reason == "crossing"


def test_a_line_thinner_than_half_a_texel_is_reported():
    side = np.zeros((320, 320), np.float32)
    side[148:152, 40:280] = 1  # between two rows of texels, 0.2 texels thick
    fitted = fit(side, (16, 16))
    assert fitted.faults
    assert {fault.reason for fault in fitted.faults} <= {"too near", "too small"}
    assert sum(fault.pixels for fault in fitted.faults) <= fitted.mismatch * side.size + 0.5


def test_an_x_of_two_strokes_and_a_t_are_junctions_whatever_the_angle():
    """Strokes thinner than half a texel: their sides are too near to each other along them, but not where they meet."""
    for turn in (0, 17, 45, 71):
        assert reason(strokes(np.add([0, 90, 180, 270], turn), 8)) == "junction"
        assert reason(strokes(np.add([0, 90, 180], turn), 8)) == "junction"
        assert reason(1 - strokes(np.add([0, 90, 180], turn), 8)) == "junction"


def test_only_where_the_bars_meet_is_a_junction():
    plus = strokes([0, 90, 180], 8)
    wrong = spot(plus, 100, 100) | spot(plus, 40, 100) | spot(plus, 100, 170)
    found = {(round(fault.x), round(fault.y)): fault.reason for fault in find_faults(plus, wrong, CELL)}
    assert found == {(100, 100): "junction", (40, 100): "too near", (100, 170): "too near"}
