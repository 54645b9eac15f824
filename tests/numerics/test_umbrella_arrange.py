"""Arrangements: where umbrellas lie, how large and turned, and what lies in front."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt
from scipy.spatial import cKDTree

from fexel.errors import FexelError
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel.textures.umbrella_cells import cell_statistics
from fexel_tools.umbrella_arrange import ArrangeOptions, arrange
from fexel_tools.umbrella_placement import blue_noise_points, random_points
from fexel_tools.umbrella_placement_file import read_placement


@dataclass(frozen=True, eq=False)
class _Base:
    name: str = "leaf"
    points: np.ndarray = field(
        default_factory=lambda: np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.25], [-0.5, 0.0], [0.0, -0.25]])
    )

    @property
    def morph_points(self):
        return self.points


LEAF = _Base()
NAMES = ("leaf", "petal")


def _generator(seed=1):
    return np.random.Generator(np.random.PCG64(seed))


def _strewn(options, bases=(LEAF,)):
    return arrange(bases, options)


# Places


@pytest.mark.parametrize("put", [random_points, blue_noise_points])
@pytest.mark.parametrize(("count", "grid"), [(0, (3, 2)), (1, (1, 1)), (2, (1, 1)), (3, (5, 1)), (2000, (40, 15))])
def test_places_are_as_many_as_wanted_and_lie_in_the_grid(put, count, grid):
    points = put(count, grid, _generator())
    assert points.shape == (count, 2)
    assert ((points >= 0) & (points < grid)).all()


def test_blue_noise_keeps_its_distance_also_across_the_border():
    grid, count = (40, 15), 2000
    points = blue_noise_points(count, grid, _generator())
    nearest = cKDTree(points, boxsize=grid).query(points, 2)[0][:, 1]
    hexagonal = np.sqrt(2 / np.sqrt(3) * grid[0] * grid[1] / count)
    assert nearest.min() > 0.65 * hexagonal
    shifted = (points + (20.0, 7.5)) % grid  # what lay at the border lies in the middle
    inner = np.all((shifted > 3) & (shifted < np.subtract(grid, 3)), axis=1)
    assert cKDTree(shifted).query(shifted[inner], 2)[0][:, 1].min() > 0.65 * hexagonal


def test_blue_noise_has_little_power_at_low_frequencies():
    """White noise has a mean power of 1 at every frequency."""
    count, side = 1500, 30
    k = np.arange(-12, 13)
    waves = np.stack(np.meshgrid(k, k), -1).reshape(-1, 2)
    norm = np.linalg.norm(waves, axis=1)
    low = waves[(norm > 0) & (norm < 0.3 * np.sqrt(count))]

    def power(points):
        return np.mean(np.abs(np.exp(-2j * np.pi / side * points @ low.T).sum(axis=0)) ** 2) / count

    assert power(blue_noise_points(count, (side, side), _generator())) < 0.1
    assert 0.8 < power(random_points(count, (side, side), _generator())) < 1.2


@pytest.mark.parametrize("placement", ["random", "blue-noise"])
def test_density_has_no_seam(placement):
    """Chi square over cells of equal area, of which many touch the border; blue noise is more even than chance."""
    placed = _strewn(ArrangeOptions(grid=(16, 16), count=8192, placement=placement))
    st = placed.matrices[:, 2, :2]
    assert ((st >= 0) & (st < 1)).all()
    found = np.histogram2d(*((st + 0.03) % 1.0).T, bins=16, range=[[0, 1], [0, 1]])[0]
    chi_square = ((found - 32) ** 2 / 32).sum()
    assert chi_square < 255 + 4 * np.sqrt(2 * 255)
    border = np.concatenate([found[0], found[-1], found[:, 0], found[:, -1]])
    assert abs(border.mean() - 32) < 4 * np.sqrt(32 / 64)


# Options


def test_umbrellas_come_from_the_seed_alone():
    options = ArrangeOptions(grid=(9, 7), count=500, seed=7, placement="blue-noise")
    first, again = _strewn(options, (LEAF, LEAF)), _strewn(options, (LEAF, LEAF))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    other = _strewn(ArrangeOptions(grid=(9, 7), count=500, seed=8, placement="blue-noise"), (LEAF, LEAF))
    assert not np.array_equal(first.matrices, other.matrices)


def test_places_stay_what_they_were_on_every_machine():
    """PCG64 and sums: no rounding decides."""
    st = _strewn(ArrangeOptions(grid=(4, 2), count=3, seed=7)).matrices[:, 2, :2]
    generator = np.random.Generator(np.random.PCG64([7, 0x741D53CD]))
    np.testing.assert_allclose(np.sort(st, axis=0), np.sort(generator.random((3, 2)), axis=0), rtol=1e-15)


def test_another_range_of_rotations_moves_no_umbrella():
    free = _strewn(ArrangeOptions(count=50, rotation=(0, 360)))
    upright = _strewn(ArrangeOptions(count=50, rotation=(0, 0)))
    np.testing.assert_array_equal(free.matrices[:, 2], upright.matrices[:, 2])
    np.testing.assert_array_equal(upright.matrices[:, 0, 1], 0)


def test_sizes_and_rotations_keep_to_their_ranges_in_square_cells():
    grid = (32, 5)
    placed = _strewn(ArrangeOptions(grid=grid, count=4000, size=(0.5, 2.0), rotation=(-30, 60), morph=(0.2, 0.7)))
    in_cells = placed.matrices[:, :2, :2] * grid
    scale = np.sqrt(np.linalg.det(in_cells))
    np.testing.assert_allclose(
        in_cells @ in_cells.transpose(0, 2, 1), scale[:, None, None] ** 2 * np.eye(2), atol=1e-12
    )
    angle = np.degrees(np.arctan2(in_cells[:, 0, 1], in_cells[:, 0, 0]))
    for values, low, high in ((scale, 0.5, 2.0), (angle, -30, 60), (placed.morphs, 0.2, 0.7)):
        assert low <= values.min() < low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) < values.max() <= high


def test_default_count_gives_the_mean_number_of_layers():
    options = ArrangeOptions(grid=(20, 10), layers=3.0, size=(0.5, 1.5))
    placed = _strewn(options)
    areas = 0.25 * np.linalg.det(placed.matrices[:, :2, :2])  # 0.25: of the leaf in patch space
    assert areas.sum() == pytest.approx(3.0, rel=0.05)


def test_cells_list_as_many_umbrellas_as_integral_geometry_says():
    """Of convex shapes of area A and perimeter P, turned at random, A + 1 + 4 P / (2 pi) touch a cell, per density."""
    options = ArrangeOptions(grid=(24, 10), count=3000, size=(1.5, 1.5))
    placed = _strewn(options)
    shape = Shape(LEAF.points, LEAF.points, LEAF.points)
    arrangement = Arrangement((shape,), *placed, np.zeros((0, 3), np.float32), options.grid, coverages=np.ones(3000))
    area, perimeter = 1.5**2 * 0.25, 1.5 * 4 * np.hypot(0.5, 0.25)
    found = cell_statistics(arrangement)
    expected = 3000 / 240 * (area + 1 + 2 * perimeter / np.pi)
    assert 0.98 * expected < found.mean < 1.1 * expected  # cells may list what only nearly touches them
    assert expected < found.most < expected + 6 * np.sqrt(expected)


def test_bases_are_taken_as_often_as_their_weights_say():
    placed = _strewn(ArrangeOptions(count=1000, weights=(3.0, 0.0, 1.0)), (LEAF, LEAF, LEAF))
    assert np.bincount(placed.shape_of, minlength=3).tolist() == [750, 0, 250]
    assert np.bincount(_strewn(ArrangeOptions(count=10), (LEAF,) * 3).shape_of).tolist() in (
        [3, 4, 3],
        [3, 3, 4],
        [4, 3, 3],
    )


def test_smaller_umbrellas_lie_in_front_where_asked():
    small = _Base("small", 0.5 * LEAF.points)
    placed = _strewn(ArrangeOptions(count=200, order="size"), (LEAF, small))
    size = np.linalg.det(placed.matrices[:, :2, :2]) * np.where(placed.shape_of == 0, 1.0, 0.25)
    assert (np.diff(size) >= 0).all()


def test_order_is_random_otherwise():
    placed = _strewn(ArrangeOptions(count=2000))
    size = np.linalg.det(placed.matrices[:, :2, :2])
    assert abs(np.corrcoef(np.arange(2000), size)[0, 1]) < 0.1
    assert abs(np.corrcoef(np.arange(2000), placed.matrices[:, 2, 0])[0, 1]) < 0.1


def test_a_hundred_thousand_umbrellas_are_finite():
    placed = _strewn(ArrangeOptions(grid=(256, 256), count=100_000, placement="blue-noise"))
    assert len(placed.matrices) == 100_000
    assert np.isfinite(placed.matrices).all()
    assert len(np.unique(placed.matrices[:, 2], axis=0)) == 100_000


def test_no_umbrella_is_an_arrangement():
    assert [len(part) for part in _strewn(ArrangeOptions(count=0))] == [0, 0, 0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": (0, 4)}, "--grid: 0x4, expected cells >= 1"),
        ({"count": -1}, "--count: -1, expected 0 to 1000000"),
        ({"layers": float("nan")}, "--layers: nan, expected a number > 0"),
        ({"size": (2.0, 1.0)}, "--size: 2,1, expected 0 < smallest <= largest"),
        ({"size": (1e-4, 1e-4)}, "--layers: 3 of size 0.0001,0.0001 take"),
        ({"morph": (0.0, 1.5)}, "--morph: "),
        ({"weights": (1.0, 1.0)}, "--weights: 1,1, expected 1 numbers >= 0"),
        ({"weights": (0.0,)}, "--weights: all are 0"),
        ({"order": "upwards"}, "--order: 'upwards' is unknown, expected one of auto, random, size, given"),
        ({"placement": "nowhere.csv"}, "nowhere.csv: no such file, expected random, blue-noise, a CSV file"),
    ],
)
def test_wrong_options_are_named(change, message):
    with pytest.raises(FexelError) as error:
        _strewn(ArrangeOptions(**change))
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


# CSV


def _csv(tmp_path, text):
    file = tmp_path / "points.csv"
    file.write_text(text, encoding="utf-8")
    return str(file)


def test_rows_without_names_hold_place_rotation_scale_base_and_layer(tmp_path):
    given = read_placement(_csv(tmp_path, "0.25,0.5,90,2,petal,1\n\n# beside\n0.75, 0.5\n"), (4, 4), NAMES)
    np.testing.assert_array_equal(given.positions, [[0.25, 0.5], [0.75, 0.5]])
    np.testing.assert_array_equal(given.rotations, [90, np.nan])
    np.testing.assert_array_equal(given.scales, [2, np.nan])
    np.testing.assert_array_equal(given.bases, [1, -1])
    np.testing.assert_array_equal(given.layers, [1, np.nan])


def test_named_columns_come_in_any_order_and_in_cells(tmp_path):
    given = read_placement(_csv(tmp_path, "\ufeffBase,Row,Column,Size\n0,1,2,0.5\n,2,4,\n"), (8, 4), NAMES)
    np.testing.assert_array_equal(given.positions, [[0.25, 0.25], [0.5, 0.5]])
    np.testing.assert_array_equal(given.sizes, [0.5, np.nan])
    np.testing.assert_array_equal(given.bases, [0, -1])


def test_given_umbrellas_lie_where_the_file_says(tmp_path):
    rows = "s,t,rotation,size,base,layer\n0.1,0.2,90,1,leaf,0\n1.3,-0.2,0,2,petal,5\n0.5,0.5,0,1,leaf,0\n"
    options = ArrangeOptions(grid=(4, 2), placement=_csv(tmp_path, rows))
    placed = arrange((LEAF, _Base("petal")), options)
    np.testing.assert_array_equal(placed.shape_of, [1, 0, 0])  # the highest layer in front, then row by row
    np.testing.assert_allclose(placed.matrices[:, 2, :2], [[0.3, 0.8], [0.1, 0.2], [0.5, 0.5]])
    np.testing.assert_allclose(placed.matrices[0, :2, :2], [[0.5, 0], [0, 1]])
    np.testing.assert_allclose(placed.matrices[1, :2, :2], [[0, 0.5], [-0.25, 0]], atol=1e-16)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": no rows, expected one umbrella a row"),
        ("x,y\n", ": no rows, expected one umbrella a row"),
        ("x,y\n0.1,0.2\n0.3,abc\n", ":3: y is 'abc', expected a finite number"),
        ("x,y\n0.1,nan\n", ":2: y is 'nan', expected a finite number"),
        ("0.1,0.2,0,-1\n", ":1: scale is '-1', expected a positive number"),
        ("0.1\n", ":1: no x and y, expected two numbers"),
        ("x,y,colour\n1,2,3\n", ":1: column 'colour' is unknown, expected some of x, y, s, t"),
        ("x,rotation\n1,2\n", ":1: columns x,rotation, expected x,y or column,row"),
        ("x,s,y\n1,2,3\n", ":1: columns x,s,y, expected x,y or column,row, and each name once"),
        ("x,y\n1,2,3\n", ":2: 3 columns, expected at most 2: x,y"),
        ("x,y,base\n1,2,7\n", ":2: base is '7', expected 0 to 1 or one of leaf, petal"),
        ("x,y,base\n1,2,rose\n", ":2: base is 'rose', expected 0 to 1 or one of leaf, petal"),
    ],
)
def test_a_fault_in_a_file_of_points_is_named_with_its_line(tmp_path, text, message):
    file = _csv(tmp_path, text)
    with pytest.raises(FexelError) as error:
        read_placement(file, (4, 4), NAMES)
    assert str(error.value).startswith(file + message)
    assert "\n" not in str(error.value)


def test_a_binary_file_of_points_is_refused(tmp_path):
    file = tmp_path / "points.csv"
    file.write_bytes(b"\xff\xfe\x00\x01\x80")
    with pytest.raises(FexelError, match=r"points\.csv: .* expected a CSV file of points"):
        read_placement(str(file), (4, 4), NAMES)


def test_a_count_that_a_file_does_not_have_is_refused(tmp_path):
    with pytest.raises(FexelError, match=r"--count: 5, but .*points\.csv has 1 points, expected no count"):
        _strewn(ArrangeOptions(count=5, placement=_csv(tmp_path, "0.5,0.5\n")))


@pytest.mark.parametrize("size", [16.1, 60.0, 1e200])
def test_sizes_that_readers_leave_out_are_refused(tmp_path, size):
    """The leaf is one cell wide; on a single cell it may span 16 of them."""
    assert len(_strewn(ArrangeOptions((1, 1), 3, size=(16.0, 16.0), rotation=(0.0, 0.0))).shape_of) == 3
    with pytest.raises(FexelError, match=r"^--size: .* cells span .* of 1 x 1 cells, expected at most 16 times$"):
        _strewn(ArrangeOptions((1, 1), 3, size=(size, size), rotation=(0.0, 0.0)))
    rows = f"s,t,size,rotation\n0.5,0.5,2,0\n0.5,0.5,{size},0\n"
    with pytest.raises(FexelError, match=r"^.*points\.csv: umbrella 2 of 2: .* expected at most 16 times$"):
        _strewn(ArrangeOptions((1, 1), placement=_csv(tmp_path, rows)))


# USD


def _stage(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "points.usda"))
    UsdGeom.Xform.Define(stage, "/World")
    return stage


def _read(stage, path="/World/Points", grid=(8, 4)):
    stage.Save()
    return read_placement(f"{stage.GetRootLayer().realPath}:{path}", grid, NAMES)


def _lattice(columns, rows, spacing=2.0):
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return np.stack([x.ravel(), y.ravel()], axis=1) * spacing


def test_a_lattice_of_points_goes_on_across_the_border(tmp_path):
    stage, flat = _stage(tmp_path), _lattice(8, 4)
    points = UsdGeom.Points.Define(stage, "/World/Points")
    points.CreatePointsAttr(Vt.Vec3fArray([Gf.Vec3f(x, 7, -y) for x, y in flat]))  # y up: seen from above
    points.CreateWidthsAttr(Vt.FloatArray([3.0]))
    given = _read(stage)
    np.testing.assert_allclose(given.positions, (flat / 2 + 0.5) / (8, 4), atol=1e-6)
    np.testing.assert_allclose(given.sizes, 1.5, rtol=1e-6)  # a cell is 2 units wide


@pytest.mark.parametrize("axes", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_points_are_seen_from_the_end_of_their_shortest_axis(tmp_path, axes):
    """Right-handed: what runs counter-clockwise seen from there runs so in st."""
    corners = np.array([[0, 0, 0], [4, 0, 0], [4, 3, 0], [0, 3, 0]], np.float64)[:, np.argsort(axes)]
    stage = _stage(tmp_path)
    points = [Gf.Vec3f(*map(float, corner)) for corner in corners]
    UsdGeom.Mesh.Define(stage, "/World/Points").CreatePointsAttr(Vt.Vec3fArray(points))
    x, y = _read(stage).positions.T
    assert np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) > 0


def test_instances_bring_scale_rotation_and_base_and_may_be_hidden(tmp_path):
    stage = _stage(tmp_path)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Points")
    instancer.CreatePositionsAttr([Gf.Vec3f(x, y, 0) for x, y in _lattice(2, 2)])
    turned = Gf.Rotation(Gf.Vec3d(0, 0, 1), 30).GetQuat()
    still = Gf.Quath(1, 0, 0, 0)
    instancer.CreateOrientationsAttr([Gf.Quath(turned), still, still, still])
    instancer.CreateScalesAttr([Gf.Vec3f(4, 1, 9)] + [Gf.Vec3f(1)] * 3)
    instancer.CreateProtoIndicesAttr([1, 0, 0, 1])
    instancer.CreatePrototypesRel().SetTargets(["/World/A", "/World/B"])
    instancer.CreateInvisibleIdsAttr([2])
    given = _read(stage)
    np.testing.assert_allclose(given.positions, [[0.25, 0.25], [0.75, 0.25], [0.75, 0.75]])
    np.testing.assert_allclose(given.rotations, [30, 0, 0], atol=0.1)  # 0.1: halves
    np.testing.assert_allclose(given.scales, [2, 1, 1])
    np.testing.assert_array_equal(given.bases, [1, 0, 1])


@pytest.mark.parametrize("points", [[(1, 2, 3)], [(1, 2, 3), (1, 2, 3)], [(0, 0, 0), (1, 0, 0), (3, 0, 0)]])
def test_points_without_area_have_places(tmp_path, points):
    stage = _stage(tmp_path)
    UsdGeom.Points.Define(stage, "/World/Points").CreatePointsAttr([Gf.Vec3f(*map(float, p)) for p in points])
    positions = _read(stage).positions
    assert positions.shape == (len(points), 2)
    assert ((positions >= 0) & (positions <= 1)).all()


def test_a_prim_without_points_is_named(tmp_path):
    stage = _stage(tmp_path)
    UsdGeom.Points.Define(stage, "/World/Points")
    UsdGeom.Points.Define(stage, "/World/Bad").CreatePointsAttr([Gf.Vec3f(0, float("nan"), 0)])
    for path, message in (
        ("/World/Points", ":/World/Points: no points, expected at least one"),
        ("/World/Bad", r":/World/Bad: points\[0\] is \(0.0, nan, 0.0\), expected finite"),
        ("/World", ":/World: is Xform, expected a Points, PointInstancer or Mesh prim"),
        ("/Elsewhere", ": no prim /Elsewhere, expected"),
        ("/not a path", ": no prim /not a path, expected"),
    ):
        with pytest.raises(FexelError, match=r"points\.usda" + message):
            _read(stage, path)
    with pytest.raises(FexelError, match="no prim is named"):
        read_placement(stage.GetRootLayer().realPath, (4, 4), NAMES)


def test_a_file_that_is_no_stage_is_refused(tmp_path):
    (tmp_path / "broken.usda").write_text("#usda 1.0\n(")
    with pytest.raises(FexelError, match=r"broken\.usda: not a USD stage that can be read"):
        read_placement(f"{tmp_path}/broken.usda:/World", (4, 4), NAMES)
