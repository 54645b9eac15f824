"""What umbrellas take to store: table 1 of the paper beside its own formulas, and ours, raw and compressed.

Eq. (2) of "Just-in-time texture synthesis" (2012) counts the umbrellas in four-byte words, eq. (3) the explicit texture
that shows as much, with the largest, mean and smallest umbrella. The paper does not tell the sizes of its umbrellas,
so of its own rows eq. (2) can be checked, and what its printed factors say of eq. (3): the mean extent of an umbrella.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from pxr import Usd

from bench.harness import REPOSITORY, Row, progress
from bench.umbrella_setting import Ground, fall_leaves_ground, ground_of_stage, real_leaves
from fexel.textures.umbrella_cells import cell_statistics
from fexel_tools.umbrella_storage import compressed_sizes, explicit_words, umbrella_words

NAME = "umbrella storage"
_WORD = 4  # bytes
_TEXELS = 256 * 256
# name: b, v, k, n, grid, printed factors (min, average, max)
_TABLE_1 = {
    "Fall Leafs": (9, 63, 19, 6100, (64, 24), (16, 25, 47)),
    "Berries": (3, 58, 16, 14000, (64, 24), (10, 23, 48)),
    "Green Leafs": (6, 51, 68, 25000, (64, 24), (5, 13, 53)),
    "Peppers": (4, 35, 37, 14000, (64, 24), (21, 32, 56)),
    "Flowers": (6, 74, 12, 390, (10, 13), (5, 10, 18)),
}
_STAGES = "stages/"
_RAW, _COMPRESSED = 25.0, 4.0


def rows(quick: bool) -> Iterator[Row]:
    """Table 1, then the grounds that we make."""
    for name, (b, v, k, n, grid, factors) in _TABLE_1.items():
        yield _paper_row(name, b, v, k, n, grid, factors)
    with tempfile.TemporaryDirectory() as folder:
        for ground in progress(list(_grounds(Path(folder), quick)), "storage"):
            yield from _rows(ground)


def _paper_row(name: str, b: int, v: int, k: int, n: int, grid: tuple[int, int], factors: tuple[int, ...]) -> Row:
    cells = grid[0] * grid[1]
    words = b * _TEXELS + 2 * b * v + n * (1 + 3 * v) + k * cells
    extents = [(_TEXELS * cells / (factor * words)) ** 0.5 for factor in factors]
    sizes = ", ".join(f"{extent:.2f}" for extent in extents)
    return Row(
        measure="eq. (2), table 1",
        setting=f"{name}: b {b}, v {v}, k {k}, n {n}, grid {grid[0]} x {grid[1]}",
        value=words * _WORD / 1e6,
        unit="MB",
        reference="printed " + ", ".join(f"{factor}:1" for factor in factors),
        note=f"by eq. (3) these factors mean umbrellas {sizes} cells wide (largest, average, smallest)",
    )


def _rows(ground: Ground) -> Iterator[Row]:
    arrangement, sizes = ground.arrangement, ground.texture_sizes
    statistics = cell_statistics(arrangement)
    umbrellas = umbrella_words(arrangement, sizes, statistics.most)
    explicit = explicit_words(arrangement, sizes)
    asked = {} if ground.name.startswith(_STAGES) else {"comparison": ">="}  # of grounds as large as the paper's
    words = f"{umbrellas * _WORD / 1e6:.2f} MB, explicit {explicit.average * _WORD / 1e6:.0f} MB"
    yield Row(
        measure="explicit over umbrellas, average by eqs. (2) and (3)",
        setting=ground.name,
        value=explicit.average / umbrellas,
        unit=": 1",
        target=_RAW if asked else None,
        reference="25:1 (16:1, 47:1) printed for Fall Leafs",
        note=f"least {explicit.least / umbrellas:.1f}, most {explicit.most / umbrellas:.1f}; "
        f"k {statistics.most}, lists of {statistics.mean:.1f} on average; {words}",
        **asked,
    )
    small = compressed_sizes(arrangement, ground.textures, ground.background)
    parts = {"textures": small.textures, "contours": small.contours, "arrangement": small.arrangement}
    listed = ", ".join(f"{name} {nbytes / 1e3:.0f}" for name, nbytes in parts.items())
    yield Row(
        measure="the same, both sides compressed, JPEG quality 50",
        setting=ground.name,
        value=small.ratio,
        unit=": 1",
        target=_COMPRESSED if asked else None,
        reference="3:1 printed for Fall Leafs",
        note=f"{small.umbrellas / 1e3:.0f} kB ({listed}), explicit {small.explicit / 1e6:.2f} MB",
        **asked,
    )


def _grounds(folder: Path, quick: bool) -> Iterator[Ground]:
    yield fall_leaves_ground(folder)
    if (real := real_leaves(folder / "real")) is not None:
        yield real
    if quick:
        return
    for folder in sorted(REPOSITORY.glob(f"{_STAGES}umbrella_*")):
        stage = Usd.Stage.Open(str(next(folder.glob("*.usda"))))
        prim = next(prim for prim in stage.Traverse() if prim.GetTypeName() == "UmbrellaTexture")
        yield ground_of_stage(stage, str(prim.GetPath()), f"{_STAGES}{folder.name}")
