"""Base umbrellas: contours, centres that see all of them, what is lost where none does, and textures."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fexel.errors import FexelError
from fexel_tools.umbrella_base import BaseOptions, companion_base, make_bases
from fexel_tools.umbrella_centre import centroid, clearance, kernel, kernel_point, most_visible, sees_all, visible_curve
from fexel_tools.umbrella_contour import area, is_simple, simplify, trace
from fexel_tools.umbrella_elements import Element


def _element(opacity, color=(0.2, 0.4, 0.1), **given):
    opacity = np.asarray(opacity, np.float32)
    color = np.broadcast_to(np.float32(color), (*opacity.shape, 3))
    height, width = opacity.shape
    rows, columns = np.nonzero(opacity >= 0.5)
    scale = float(max(np.ptp(rows), np.ptp(columns)) + 1) if len(rows) else 1.0
    values = {"box": (0, 0, width, height), "scale_px": scale, "photo_size": (width, height)} | given
    return Element("a", Path("a.png"), color, opacity, False, 1.0, **values)


def _filled(polygon, size):
    """(size, size) coverage of a polygon, y up; OpenCV's filling adds a sixteenth of a pixel."""
    mask = np.zeros((size * 8, size * 8), np.uint8)
    corners = np.stack([polygon[:, 0], size - polygon[:, 1]], axis=1) * 8 - 0.5
    cv2.fillPoly(mask, [np.rint(corners * 16).astype(np.int32)], 1, shift=4)
    return mask.reshape(size, 8, size, 8).mean(axis=(1, 3)).astype(np.float32)


def _polar(radius, size=200, x=100, y=100):
    angle = np.linspace(0, 2 * np.pi, len(radius), endpoint=False)
    return _filled(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], axis=1), size)


def _blob(rng, lobes=6, strength=0.15):
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    radius = np.ones(720)
    for order in range(1, lobes + 1):
        radius += strength * rng.normal() / np.sqrt(order) * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
    return _polar(80 * np.clip(radius, 0.2, None) / radius.max())


def _star(tips=5, inner=0.4):
    return _polar(np.where(np.arange(2 * tips) % 2, inner, 1.0) * 90)


def _crescent():
    rows, columns = np.mgrid[:200, :200] + 0.5
    return ((np.hypot(columns - 100, rows - 100) < 85) & (np.hypot(columns - 145, rows - 100) > 75)).astype(np.float32)


def _spiral(turns=1.6, width=18):
    image = np.zeros((200, 200), np.uint8)
    angle = np.linspace(0, 2 * np.pi * turns, 400)
    radius = 20 + 60 * angle / angle[-1]
    points = np.stack([100 + radius * np.cos(angle), 100 + radius * np.sin(angle)], axis=1)
    cv2.polylines(image, [np.rint(points * 16).astype(np.int32)], False, 1, width, shift=4)
    return image.astype(np.float32)


SHAPES = {
    "star": _star(),
    "seven tips": _star(7, 0.3),
    "crescent": _crescent(),
    "spiral": _spiral(),
    "cross": np.pad(np.ones((150, 24), np.float32), ((25, 25), (88, 88)))
    + np.pad(np.ones((24, 63), np.float32), ((88, 88), (25, 112))),
    "square": np.pad(np.ones((100, 100), np.float32), 50),
    "line": np.pad(np.ones((1, 120), np.float32), 40),
    "pixel": np.ones((1, 1), np.float32),
    "two pixels": np.ones((1, 2), np.float32),
}


def _crosses(base):
    """Cross product of every sector about the centre, over the largest."""
    contour = base.points[1:] - base.points[0]
    after = np.roll(contour, -1, axis=0)
    return contour[:, 0] * after[:, 1] - contour[:, 1] * after[:, 0]


def _contour_px(base, element):
    left, top, right, bottom = base.window
    return base.tex_coords * [right - left, bottom - top] + [left, element.opacity.shape[0] - bottom]


def _check(base, element, options=None):
    """What holds for every base umbrella."""
    assert (_crosses(base) > 0).all()
    angle = np.unwrap(np.arctan2(*base.points[1:].T[::-1]))
    assert (np.diff(angle) > 0).all() and angle[-1] - angle[0] < 2 * np.pi  # once about the centre: simple
    assert (base.points[0] == 0).all() and (base.points == base.morph_points).all()
    assert 4 <= len(base.points) <= (options or BaseOptions()).vertices
    assert base.tex_coords.min() >= 0 and base.tex_coords.max() <= 1
    assert np.isfinite(base.texture).all() and 0 <= base.lost_area < 1 and base.tolerance_px >= 0
    scale = np.array(base.window[2:]) - base.window[:2]
    assert np.allclose((base.tex_coords - base.tex_coords[0]) * scale / element.scale_px, base.points, atol=1e-9)


def _iou(base, element):
    size = max(element.opacity.shape)
    opacity = np.pad(element.opacity, ((size - element.opacity.shape[0], 0), (0, size - element.opacity.shape[1])))
    covered = _filled(_contour_px(base, element)[1:], size)
    return float(np.minimum(covered, opacity).sum() / np.maximum(covered, opacity).sum())


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("vertices", [4, 16, 63])
def test_every_contour_vertex_is_visible_from_the_centre(name, vertices):
    element, options = _element(SHAPES[name]), BaseOptions(vertices=vertices)
    (base,) = make_bases([element], options)
    _check(base, element, options)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), lobes=st.integers(2, 14), strength=st.floats(0.02, 0.5))
def test_every_contour_vertex_of_blobs_is_visible_from_the_centre(seed, lobes, strength):
    element = _element(_blob(np.random.default_rng(seed), lobes, strength))
    (base,) = make_bases([element])
    _check(base, element)
    assert _iou(base, element) > 0.9 - 1.1 * base.lost_area


@pytest.mark.parametrize(("vertices", "least"), [(9, 0.93), (17, 0.975), (33, 0.985), (63, 0.985)])
def test_overlap_with_the_element_is_bounded_by_the_number_of_vertices(vertices, least, rng):
    elements = [_element(_blob(rng, 4, 0.1)) for _ in range(12)]
    bases = make_bases(elements, BaseOptions(vertices=vertices))
    overlaps = [_iou(base, element) for base, element in zip(bases, elements, strict=True)]
    assert min(overlaps) > least
    assert all(base.lost_area == 0 for base in bases)


def test_the_tolerance_is_kept_with_few_vertices_and_reached_error_is_told():
    element = _element(_polar(np.full(720, 90.0)))
    coarse, fine = (make_bases([element], BaseOptions(tolerance_px=px))[0] for px in (1.0, 0.3))
    assert coarse.tolerance_px <= 1 and fine.tolerance_px <= 0.3
    assert len(coarse.points) < len(fine.points) < 63
    few = make_bases([element], BaseOptions(vertices=7, tolerance_px=0.1))[0]
    outline = trace(element.opacity)
    contour = _contour_px(few, element)[1:].astype(np.float32)[:, None]
    farthest = max(abs(cv2.pointPolygonTest(contour, (float(x), float(y)), True)) for x, y in outline)
    assert few.tolerance_px >= farthest - 1e-3  # Hausdorff: to the polygon and from its vertices


def test_area_lost_is_what_the_centre_cannot_see():
    for name in ("crescent", "spiral"):
        element = _element(SHAPES[name])
        (base,) = make_bases([element], BaseOptions(vertices=200, tolerance_px=0.2))
        covered = _filled(_contour_px(base, element)[1:], 200)
        outside = float((element.opacity * (1 - covered)).sum() / element.opacity.sum())
        assert base.lost_area == pytest.approx(outside, abs=0.02)
        assert float((covered * (1 - element.opacity)).sum()) < 0.03 * element.opacity.sum()  # nothing is added
    star = make_bases([_element(SHAPES["star"])])[0]
    assert star.lost_area == 0


def test_the_crescent_keeps_as_much_as_any_centre_sees():
    outline = trace(SHAPES["crescent"])[::5]
    best = area(visible_curve(outline, most_visible(outline, pull=0.0)))
    others = [
        area(visible_curve(outline, np.array([x, y], float)))
        for x in range(17, 90, 9)
        for y in range(20, 190, 12)
        if cv2.pointPolygonTest(outline.astype(np.float32)[:, None], (x, y), False) > 0
    ]
    assert best > 0.99 * max(others)


def test_moving_and_turning_the_photo_moves_and_turns_the_umbrella(rng):
    shape = np.pad(_blob(rng)[10:190, 10:190], 10)
    first = make_bases([_element(shape)])[0]
    moved = make_bases([_element(np.pad(shape, ((30, 5), (12, 40))))])[0]
    assert np.allclose(moved.points, first.points, atol=1e-6)
    assert np.allclose(moved.tex_coords, first.tex_coords, atol=1e-6)
    turned = make_bases([_element(np.rot90(shape).copy())])[0]
    turned_back = np.stack([turned.points[:, 1], -turned.points[:, 0]], axis=1)
    overlap = [_filled(100 + 90 * points[1:], 200) for points in (first.points, turned_back)]
    assert np.minimum(*overlap).sum() / np.maximum(*overlap).sum() > 0.98


def test_t_runs_up_and_contours_run_counter_clockwise():
    opacity = np.zeros((60, 80), np.float32)
    opacity[5:25, 20:60] = 1  # the upper part of the photo: a wide box
    opacity[25:50, 35:45] = 1  # with a stem below
    (base,) = make_bases([_element(opacity)])
    assert area(base.points[1:]) > 0
    wide = np.abs(base.points[1:, 0]) > 0.3
    assert wide.any() and base.points[1:][wide, 1].min() > base.points[1:, 1].min() + 0.3


def test_elements_of_one_photo_keep_their_sizes():
    big, small = _element(_polar(np.full(90, 80.0))), _element(_polar(np.full(90, 40.0)), scale_px=160.0)
    extents = [np.ptp(base.points, axis=0).max() for base in make_bases([big, small])]
    assert extents[0] == pytest.approx(1, abs=0.02) and extents[1] == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("pixel", [1, 4])
def test_an_element_that_was_reduced_has_the_same_size_in_patch_space(pixel):
    side = 200 * pixel
    box = (0, 0, side, side)
    element = _element(_star(), pixel=pixel, box=box, scale_px=180.0 * pixel, photo_size=(side, side))
    (base,) = make_bases([element], BaseOptions(tolerance_px=float(pixel)))
    assert np.ptp(base.points, axis=0).max() == pytest.approx(0.97, abs=0.05)


def test_hints_are_pixels_or_shares_and_are_moved_into_the_kernel():
    element = _element(_star(5, 0.6))
    for hint in ((110.0, 95.0), (0.55, 0.475)):
        (base,) = make_bases([element], BaseOptions(hints={"a.png": [hint]}))
        assert np.allclose(_contour_px(base, element)[0], (110, 105), atol=0.5)
    (base,) = make_bases([element], BaseOptions(centre="105,100"))
    assert np.allclose(_contour_px(base, element)[0], (105, 100), atol=0.5)
    (base,) = make_bases([element], BaseOptions(hints={"a": [(100.0, 15.0)]}))  # in a tip
    _check(base, element)
    assert base.lost_area == 0 and _contour_px(base, element)[0, 1] > 102


def test_veins_that_converge_draw_the_centre():
    rows, columns = np.mgrid[:240, :240] + 0.5
    x, y = 120.0, 190.0  # near the stalk
    opacity = ((columns - 120) ** 2 / 85**2 + (rows - 120) ** 2 / 110**2 < 1).astype(np.float32)
    angle = np.arctan2(rows - y, columns - x)
    veins = np.zeros((240, 240))
    for direction in np.radians([-150, -120, -90, -60, -30, 180, 0]):
        across = np.abs(np.sin(angle - direction)) * np.hypot(rows - y, columns - x)
        veins = np.maximum(veins, np.exp(-((across / 2) ** 2)) * (np.cos(angle - direction) > 0))
    color = np.stack([0.1 + 0.25 * veins, 0.3 + 0.3 * veins, 0.05 + 0.1 * veins], axis=2).astype(np.float32)
    element = _element(opacity)
    element = Element("a", Path("a.png"), color, opacity, False, 1.0, element.box, element.scale_px)
    (base,) = make_bases([element], BaseOptions(centre="veins"))
    assert np.hypot(*(_contour_px(base, element)[0] - (x, 240 - y))) < 5
    (middle,) = make_bases([element], BaseOptions(centre="centroid"))
    assert np.hypot(*(_contour_px(middle, element)[0] - (120, 120))) < 3


@pytest.mark.parametrize("pattern", ["parallel", "noise", "plain"])
def test_the_middle_is_the_centre_where_no_veins_converge(pattern, rng):
    rows, columns = np.mgrid[:240, :240] + 0.5
    opacity = ((columns - 120) ** 2 / 85**2 + (rows - 120) ** 2 / 110**2 < 1).astype(np.float32)
    light = {
        "parallel": 0.5 + 0.4 * np.sin((rows + 0.5 * columns) / 4),
        "noise": cv2.GaussianBlur(rng.random((240, 240)), (0, 0), 1.5),
        "plain": np.full((240, 240), 0.5),
    }[pattern]
    element = _element(opacity)
    color = np.repeat(light[..., None], 3, axis=2).astype(np.float32)
    element = Element("a", Path("a.png"), color, opacity, False, 1.0, element.box, element.scale_px)
    veins, middle = (make_bases([element], BaseOptions(centre=name))[0] for name in ("veins", "auto"))
    assert np.array_equal(_contour_px(veins, element), _contour_px(middle, element))


def test_a_texture_of_an_opaque_element_has_neither_alpha_nor_a_fringe():
    opacity = cv2.GaussianBlur(_star(5, 0.5), (0, 0), 0.8)
    dark = np.where(opacity[..., None] > 0.95, np.float32([0.6, 0.5, 0.2]), np.float32(0))  # what an editor leaves
    plain = _element(opacity)
    element = Element("a", Path("a.png"), dark.astype(np.float32), opacity, False, 1.0, plain.box, plain.scale_px)
    (base,) = make_bases([element], BaseOptions(texture_size=64))
    assert not base.has_alpha and (base.texture[..., 3] == 1).all()
    assert np.abs(base.texture[..., :3] - np.float32([0.6, 0.5, 0.2])).max() < 1e-3
    assert max(base.texture.shape[:2]) == 64


def test_holes_and_translucent_parts_keep_their_alpha_and_noise_does_not(rng):
    disc = _polar(np.full(180, 85.0))
    hole = disc * (1 - _polar(np.full(90, 15.0), x=130, y=120))
    (base,) = make_bases([_element(hole)])
    assert base.has_alpha
    left, top, right, _ = base.window
    scale = base.texture.shape[1] / (right - left)
    column, row = int((130 - left) * scale), int((80 - top) * scale)
    assert base.texture[row, column, 3] < 0.01
    assert base.texture[2, 2, 3] > 0.99 and base.texture[row, 3, 3] > 0.99  # no second edge along the contour
    glass = make_bases([_element(np.where(disc > 0.5, np.float32(0.55), 0))])[0]
    assert glass.has_alpha and np.allclose(glass.texture[..., 3], 0.55, atol=0.01)
    noisy = disc * np.where(rng.uniform(size=disc.shape) < 0.002, np.float32(0.3), 1)
    assert not make_bases([_element(noisy)])[0].has_alpha


def test_photos_are_reduced_by_area_and_never_enlarged():
    opacity = np.pad(np.ones((90, 60), np.float32), 10)
    element = _element(opacity)
    checker = ((np.indices(opacity.shape).sum(axis=0) % 2)[..., None] * np.ones(3)).astype(np.float32)
    element = Element("a", Path("a.png"), checker, opacity, False, 1.0, element.box, element.scale_px)
    (small,) = make_bases([element], BaseOptions(texture_size=47))
    assert np.abs(small.texture[5:-5, 5:-5, :3] - 0.5).max() < 0.1  # the linear mean
    (large,) = make_bases([element], BaseOptions(texture_size=4096))
    assert large.texture.shape[:2] == (large.window[3] - large.window[1], large.window[2] - large.window[0])
    assert max(large.texture.shape[:2]) < 100


def test_textures_show_at_their_coordinates_what_the_photo_shows_there(rng):
    opacity = _blob(rng)
    rows, columns = np.mgrid[:200, :200] + 0.5
    color = np.stack([columns / 200, 1 - rows / 200, np.full((200, 200), 0.5)], axis=2).astype(np.float32)
    element = _element(opacity)
    element = Element("a", Path("a.png"), color, opacity, False, 1.0, element.box, element.scale_px)
    for size in (256, 100):
        (base,) = make_bases([element], BaseOptions(texture_size=size))
        height, width = base.texture.shape[:2]
        s, t = (base.tex_coords[1:] * 0.8 + base.tex_coords[0] * 0.2).T
        seen = base.texture[np.clip(((1 - t) * height).astype(int), 0, height - 1), (s * width).astype(int)]
        x, y = (_contour_px(base, element)[1:] * 0.8 + _contour_px(base, element)[0] * 0.2).T
        assert np.abs(seen[:, 0] - x / 200).max() < 1.5 / size + 0.01
        assert np.abs(seen[:, 1] - y / 200).max() < 1.5 / size + 0.01


def test_a_companion_map_is_cut_with_the_same_contour(rng):
    element = _element(_blob(rng))
    (base,) = make_bases([element], BaseOptions(texture_size=80))
    normals = _element(element.opacity, (0.5, 0.25, 1.0))
    other = companion_base(base, normals)
    assert other.texture.shape == base.texture.shape and (other.tex_coords == base.tex_coords).all()
    assert np.allclose(other.texture[..., :3], (0.5, 0.25, 1.0), atol=1e-4)


def test_the_kernel_of_known_polygons():
    square = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], float)
    assert area(kernel(square)) == pytest.approx(16)
    assert clearance(square).radius == pytest.approx(2, abs=1e-3)
    notched = np.array([[0, 0], [4, 0], [4, 4], [2, 2], [0, 4]], float)  # the notch looks down: a triangle sees all
    assert area(kernel(notched)) == pytest.approx(4)
    ell = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 4], [0, 4]], float)
    assert area(kernel(ell)) == pytest.approx(1)
    horseshoe = np.array([[0, 0], [5, 0], [5, 4], [4, 4], [4, 1], [1, 1], [1, 4], [0, 4]], float)
    assert len(kernel(horseshoe)) == 0 and clearance(horseshoe).radius == 0
    assert np.allclose(centroid(square), (2, 2))
    assert np.allclose(kernel_point(square, np.array([9.0, 2.0]), clearance(square)), (3, 2), atol=1e-2)
    assert sees_all(np.array([0.5, 0.5]), ell) and not sees_all(np.array([3.0, 0.5]), ell)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6), count=st.integers(5, 24))
def test_points_of_the_kernel_see_all_and_points_outside_do_not(seed, count):
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    radius = rng.uniform(0.3, 1, count)
    polygon = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    if not is_simple(polygon):
        return
    region = kernel(polygon)
    points = rng.uniform(-1, 1, (60, 2))
    inside = [
        len(region) > 0 and cv2.pointPolygonTest(region.astype(np.float32)[:, None], (float(x), float(y)), True)
        for x, y in points
    ]
    for point, depth in zip(points, inside, strict=True):
        if len(region) and abs(depth) < 1e-4:
            continue  # float32 of the test, not of the kernel
        assert sees_all(point, polygon) == (len(region) > 0 and depth > 0)


def test_a_traced_outline_is_exact_where_the_picture_is():
    rows, columns = np.mgrid[:1600, :1600] / 8 + 1 / 16
    disc = (np.hypot(rows - 100, columns - 100) < 70).reshape(200, 8, 200, 8).mean(axis=(1, 3))
    outline = trace(disc.astype(np.float32))
    assert area(outline) == pytest.approx(np.pi * 70**2, rel=1e-3)
    assert np.abs(np.hypot(*(outline - 100).T) - 70).max() < 0.1
    assert area(trace(np.ones((7, 5), np.float32))) == pytest.approx(35, abs=0.6)  # cut corners
    assert trace(np.zeros((9, 9), np.float32)).shape == (0, 2)


def test_few_vertices_are_chosen_at_the_corners():
    outline = trace(np.pad(np.ones((80, 60), np.float32), 10))
    polygon = simplify(outline, 4, 0.5)
    corners = np.array([[10, 10], [70, 10], [70, 90], [10, 90]], float)
    off = np.hypot(*(polygon.vertices[:, None] - corners[None]).transpose(2, 0, 1)).min(axis=0)
    assert len(polygon.vertices) == 4 and off.max() < 1


def test_wrong_options_and_empty_elements_are_errors_in_one_line():
    element = _element(_star())
    for options, message in (
        (BaseOptions(vertices=3), "vertices 3, expected at least 4"),
        (BaseOptions(tolerance_px=0), "tolerance 0 pixels, expected more than 0"),
        (BaseOptions(centre="middle"), "centre 'middle', expected one of auto, centroid, veins, or x,y"),
        (BaseOptions(texture_size=1), "texture size 1, expected at least 4"),
    ):
        with pytest.raises(FexelError, match=message):
            make_bases([element], options)
    with pytest.raises(FexelError, match=r"a\.png: a has no area"):
        make_bases([_element(np.zeros((30, 30)))])


def test_real_leaves_and_cut_outs(shared_data):
    from fexel_tools.umbrella_elements import find_elements

    folder = shared_data / "umbrella"
    files = [*sorted((folder / "leaves").glob("*.png"))[::3], *sorted((folder / "cutouts_gpl2").glob("*.png"))]
    elements = [find_elements(file).elements[0] for file in files]
    bases = make_bases(elements)
    for element, base in zip(elements, bases, strict=True):
        _check(base, element)
        assert base.lost_area < 0.05
    overlaps = [_iou(base, element) for element, base in zip(elements, bases, strict=True)]
    assert min(overlaps) > 0.92 and np.median(overlaps) > 0.98


def test_centres_at_the_veins_of_real_leaves_stay_clear_of_the_contour(shared_data):
    from fexel_tools.umbrella_elements import find_elements

    folder = shared_data / "umbrella" / "leaves"
    elements = {n: find_elements(folder / f"passiflora_leaf_{n}.png").elements[0] for n in ("16", "32", "55", "61")}
    for number, element in elements.items():
        veins, middle = (make_bases([element], BaseOptions(centre=name))[0] for name in ("veins", "auto"))
        contour, center = _contour_px(veins, element)[1:], _contour_px(veins, element)[0]
        depth = cv2.pointPolygonTest(contour.astype(np.float32)[:, None], tuple(center.tolist()), True)
        assert depth > 0.015 * max(element.opacity.shape) and veins.lost_area < 0.01
        is_moved = np.hypot(*(center - _contour_px(middle, element)[0])) > 3
        assert is_moved == (number in ("16", "32")), "pinnate veins do not converge"
