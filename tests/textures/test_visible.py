"""What a view sees of a surface, in float64."""

import numpy as np
import pytest

from bench.zipmap_stage import front_view, pixel_st, quad, tilted_view
from fexel.renderer.visible import visible_surface
from fexel.scene.model import Draw, Material, Mesh


@pytest.mark.parametrize("tilt", [0, 40, 85])
@pytest.mark.parametrize("distance", [0.01, 0.4, 3.0])
def test_visible_pieces_hold_every_pixel(tilt, distance):
    view = tilted_view((0.4, 0.6), distance, tilt, 120, 80)
    pieces = visible_surface(quad(), view, ["st"]).pieces["st"]
    st, _, shown = pixel_st(view)
    inside = (st[shown][:, None] >= pieces.st_min - 1e-9) & (st[shown][:, None] <= pieces.st_max + 1e-9)
    assert inside.all(axis=2).any(axis=1).all()


def test_visible_pieces_bound_the_footprint():
    view = tilted_view((0.4, 0.6), 0.5, 60, 120, 80)
    pieces = visible_surface(quad(), view, ["st"]).pieces["st"]
    _, jacobian, shown = pixel_st(view)
    area = np.abs(np.linalg.det(jacobian[shown]))
    known = np.abs(np.linalg.det(pieces.jacobian))
    assert known.min() <= area.min() * 1.001
    assert known.max() >= area.max() * 0.999


def test_visible_surface_outside_the_view_is_none():
    assert visible_surface(quad(), front_view((2, 2), (3, 3), 10, 10), ["st"]) is None


def test_visible_surface_behind_and_around_the_eye_is_clipped():
    """The eye is in the plane of the surface, which runs from behind it to the far plane."""
    view = tilted_view((0.5, 0.5), 1e-6, 89.999, 64, 64)
    surface = visible_surface(quad(), view, ["st"])
    if surface is not None:
        assert np.isfinite(surface.pieces["st"].jacobian).all()


def test_visible_degenerate_triangles_are_left_out():
    points = np.array([[0, 0, 0], [1, 1, 0], [0.5, 0.5, 0], [0, 0, 0]], float)
    mesh = Mesh(
        "/M", points, np.zeros((4, 3), np.float32), np.array([[0, 1, 2], [0, 3, 0]], np.int32), {"st": points[:, :2]}
    )
    draw = Draw(mesh, 0, 2, np.eye(4), Material("/Material"), "/M", 0)
    surface = visible_surface(draw, front_view((0, 0), (1, 1), 32, 32), ["st"])
    assert surface is None or np.isfinite(surface.pieces["st"].jacobian).all()


def test_visible_close_up_is_rebased_and_a_wide_view_is_not():
    assert visible_surface(quad(), front_view((0, 0), (1, 1), 256, 256), ["st"]).rebased is None
    close = visible_surface(quad(), front_view((0.3, 0.3), (0.3 + 1e-7, 0.3 + 1e-7), 256, 256), ["st"])
    frame = close.st_frames["st"]
    local = close.rebased.st["st"].astype(np.float64)
    assert np.abs(local).max() <= 1.5
    assert np.abs(frame.origin + local / frame.scale - 0.3).max() < 2e-7
    assert np.abs(close.rebased.clip_position[:, :2]).max() < 1.1


def test_visible_dense_mesh_is_merged_into_few_pieces():
    side = 200
    s, t = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 1, side))
    points = np.stack([s.ravel(), t.ravel(), np.zeros(side * side)], axis=1)
    first = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([first, first + 1, first + side], 1), np.stack([first + 1, first + side + 1, first + side], 1)]
    )
    mesh = Mesh("/M", points, np.zeros((len(points), 3), np.float32), triangles.astype(np.int32), {"st": points[:, :2]})
    draw = Draw(mesh, 0, len(triangles), np.eye(4), Material("/Material"), "/M", 0)
    pieces = visible_surface(draw, front_view((0, 0), (1, 1), 512, 512), ["st"]).pieces["st"]
    assert len(pieces.st_min) < 5000
    assert np.abs(pieces.st_min.min(axis=0)).max() < 1e-12
    assert np.abs(pieces.st_max.max(axis=0) - 1).max() < 1e-12
    assert np.abs(np.linalg.norm(pieces.jacobian, axis=(2, 3)) - np.sqrt(2) / 512).max() < 1e-6
