"""What a photo adds, and a nest in which nothing coarse hides anything finer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel_tools.consistency import apply_homography
from fexel_tools.coverage import (
    Placement,
    clip_convex,
    inscribed_rectangle,
    plan_patches,
    polygon_area,
    rectangle,
)

ROOT = Placement(0, (1000, 800), np.eye(3))


def placed(number, x, y, scale, size=(800, 600), angle=0.0):
    """Photo whose top left corner lies at root pixel (x, y), with `scale` of its pixels per root pixel."""
    c, s = np.cos(angle) / scale, np.sin(angle) / scale
    return Placement(number, size, np.array([[c, -s, x], [s, c, y], [0, 0, 1.0]]))


def test_photo_inside_becomes_a_whole_patch():
    (addition,) = plan_patches(ROOT, [placed(1, 300, 200, 3.0)])
    assert addition.window == (0, 0, 800, 600)
    assert addition.parent == 0
    assert addition.scale == pytest.approx(3.0)


def test_photo_partly_outside_is_cropped_to_the_root():
    (addition,) = plan_patches(ROOT, [placed(1, -100, 700, 2.0)])
    assert addition.window == (200, 0, 800, 200)


def test_photo_as_coarse_as_the_root_adds_nothing():
    (addition,) = plan_patches(ROOT, [placed(1, 100, 100, 1.1)])
    assert addition.window is None
    assert addition.reason.startswith("adds nothing: 1.10 times")
    assert addition.below == 0


def test_photo_outside_is_rejected():
    (addition,) = plan_patches(ROOT, [placed(1, 1500, 100, 3.0)])
    assert addition.window is None
    assert addition.reason == "lies outside the root"


def test_photo_seen_at_infinity_is_rejected():
    tilted = Placement(1, (800, 600), np.array([[0.3, 0, 0], [0, 0.3, 0], [-0.002, 0, 1.0]]))
    (addition,) = plan_patches(ROOT, [tilted])
    assert addition.window is None


def test_second_of_two_equal_photos_adds_nothing_to_the_first():
    first, second = plan_patches(ROOT, [placed(1, 300, 200, 3.0), placed(2, 300, 200, 3.02)])
    assert first.window is not None
    assert second.window is None
    assert second.below == 1


def test_photo_beside_another_of_the_same_scale_is_cropped_to_what_is_new():
    """Half of it lies on the first: it keeps the new half and a margin to blend over."""
    _, second = plan_patches(ROOT, [placed(1, 300, 200, 3.0), placed(2, 433, 200, 3.01)])
    x0, y0, x1, y1 = second.window
    assert (y0, x1, y1) == (0, 800, 600)
    assert 300 <= x0 < 400


def test_detail_of_a_detail_is_nested_in_it():
    additions = plan_patches(ROOT, [placed(2, 350, 250, 12.0), placed(1, 300, 200, 3.0)])
    assert [(a.photo, a.parent) for a in additions] == [(1, 0), (2, 1)]


def test_only_the_uncovered_part_counts_as_new():
    """A photo 1.1 times finer than one that covers it wholly is rejected though it is 3.3 times finer than the root."""
    additions = plan_patches(ROOT, [placed(1, 200, 200, 3.0), placed(2, 250, 250, 3.3, size=(400, 300))])
    assert [a.window is None for a in additions] == [False, True]


def test_min_gain_is_respected():
    photos = [placed(1, 300, 200, 1.5)]
    assert plan_patches(ROOT, photos, min_gain=1.4)[0].window is not None
    assert plan_patches(ROOT, photos, min_gain=1.6)[0].window is None


photo_places = st.lists(
    st.tuples(st.floats(-200, 1100), st.floats(-200, 900), st.floats(0.8, 20.0), st.floats(-0.5, 0.5)),
    min_size=1,
    max_size=9,
)


@settings(max_examples=60, deadline=None)
@given(photo_places)
def test_nothing_coarse_is_drawn_over_anything_finer(places):
    photos = [placed(k + 1, x, y, scale, angle=angle) for k, (x, y, scale, angle) in enumerate(places)]
    additions = [a for a in plan_patches(ROOT, photos) if a.window is not None]
    pose = {p.photo: p.root_from_photo for p in photos}
    outline = {a.photo: apply_homography(pose[a.photo], rectangle(*a.window)) for a in additions}
    order = draw_order(additions)
    assert sorted(order) == sorted(outline)
    scale = {a.photo: a.scale for a in additions}
    for k, earlier in enumerate(order):
        for later in order[k + 1 :]:
            shared = polygon_area(clip_convex(outline[earlier], outline[later]))
            if shared > 1e-6 * polygon_area(outline[earlier]):
                assert scale[later] >= scale[earlier] * (1.0 - 1e-9)
    for a in additions:
        assert 0 <= a.window[0] < a.window[2] <= 800
        assert 0 <= a.window[1] < a.window[3] <= 600
        assert outline[a.photo].min() > -1e-2
        assert (outline[a.photo] < np.array(ROOT.size) + 1e-2).all()


def draw_order(additions):
    """Depth first, parents first, siblings in the order of the list: as a zipmap is drawn."""
    order = []

    def visit(parent):
        for addition in additions:
            if addition.parent == parent:
                order.append(addition.photo)
                visit(addition.photo)

    visit(0)
    return order


@given(st.floats(0.05, 1.5), st.floats(-300, 300), st.floats(-300, 300))
def test_inscribed_rectangle_lies_inside_and_is_no_sliver(angle, x, y):
    """Of a square turned by any angle at least half can be kept."""
    c, s = np.cos(angle), np.sin(angle)
    square = rectangle(0, 0, 100, 100) @ np.array([[c, s], [-s, c]]) + (x, y)
    rect = inscribed_rectangle(square)
    inside = clip_convex(rectangle(*rect), square)
    assert polygon_area(inside) == pytest.approx(polygon_area(rectangle(*rect)), rel=1e-6)
    assert polygon_area(inside) > 0.49 * 10000


def test_clip_convex_against_known_areas():
    unit = rectangle(0, 0, 1, 1)
    assert polygon_area(clip_convex(unit, rectangle(0.5, 0.5, 2, 2))) == pytest.approx(0.25)
    assert polygon_area(clip_convex(unit[::-1], rectangle(0.5, 0.5, 2, 2)[::-1])) == pytest.approx(0.25)
    assert len(clip_convex(unit, rectangle(2, 2, 3, 3))) == 0
    assert inscribed_rectangle(np.zeros((0, 2))) is None
