"""How to author umbrellas: the options, and what they may be; `umbrella_spelling` has how they are written."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fexel.errors import FexelError
from fexel_tools.umbrella_arrange import ArrangeOptions
from fexel_tools.umbrella_background import AUTO, CELL_TEXELS, NONE
from fexel_tools.umbrella_elements import KINDS

__all__ = [
    "CENTRES",
    "DIVERSIFIED",
    "LEVELS",
    "MOST_CELLS",
    "Color",
    "UmbrellaOptions",
    "check_options",
    "read_files",
]

DIVERSIFIED = ("color", "shape")
LEVELS = ("image", "merged", "none")
DRIVEN = ("diffuseColor", "emissiveColor", "normal", "roughness", "metallic", "occlusion", "opacity")
CENTRES = ("auto", "centroid", "veins")
_COLOR_INPUTS = ("diffuseColor", "emissiveColor")
_VERTICES = (4, 4096)
_TEXTURE_SIZES = (4, 4096)
MOST_CELLS = 4096

Color = tuple[float, float, float, float]


@dataclass(frozen=True)
class UmbrellaOptions:
    """How to author; the defaults are those of the command line.

    Attributes
    ----------
    grid : (int, int)
        Cells along s and t.
    count : int or None
        Umbrellas; None: as many as `layers` asks for.
    layers : float
        Mean number of umbrellas over a point.
    background : str or 4 floats
        ``auto``, ``none``, an image, or a colour: linear, straight alpha.
    background_size : float
        Texels of the background's picture on a side of a cell.
    seed : int
    kind : str
        What the inputs are: ``auto``, ``cutout``, ``object`` or ``many``.
    vertices : int
        Most vertices of a base, centre included, with those that shape diversification splits in.
    tolerance : float
        Pixels of the photo by which a contour may be off.
    centre : str
        ``auto``, ``centroid``, ``veins`` or ``x,y``, pixels of the photo.
    hints : str
        CSV or JSON file of centres, one per file; '' for none.
    diversify : tuple of str
        Of ``color`` and ``shape``.
    references : tuple of str
        Images whose colours the umbrellas take; none: each other's.
    color_blend : float
        f of c = c_texture + f c_vertices.
    morph : float
        Largest weight of the other shape, in [0, 1].
    arrangement : str
        ``random``, ``blue-noise``, a CSV file or ``stage.usd:/prim``.
    order : str
        What lies in front: ``auto``, ``random``, ``size`` or ``given``, see `ArrangeOptions`.
    size : (float, float)
        Grid cells, range of the longer side of the largest element.
    rotation : (float, float)
        Degrees.
    levels : str
        ``image``, ``merged`` or ``none``.
    shadow : (float, float)
        Where shadows fall, cells along s and t.
    shadow_strength : float
        Share of light, in [0, 1].
    texture_size : int
        Texels on the longer side of a base's texture, at most.
    raw : bool
        The inputs hold data, not colours.
    drives : str
        Input of UsdPreviewSurface; '' is diffuseColor, or roughness for raw data.
    normal_maps, roughness_maps : str
        Folder of companion maps, named as the inputs; '' for none.
    fallback_size : int
        Longer side of the picture for other applications, pixels.
    jobs : int
        Threads.
    """

    grid: tuple[int, int] = (64, 36)
    count: int | None = None
    layers: float = ArrangeOptions.layers
    background: str | Color = AUTO
    background_size: float = CELL_TEXELS
    seed: int = 0
    kind: str = "auto"
    vertices: int = 63
    tolerance: float = 1.0
    centre: str = "auto"
    hints: str = ""
    diversify: tuple[str, ...] = DIVERSIFIED
    references: tuple[str, ...] = ()
    color_blend: float = 1.0
    morph: float = 0.6
    arrangement: str = "random"
    order: str = ArrangeOptions.order
    size: tuple[float, float] = ArrangeOptions.size
    rotation: tuple[float, float] = ArrangeOptions.rotation
    levels: str = "image"
    shadow: tuple[float, float] = (0.06, -0.08)
    shadow_strength: float = 0.4
    texture_size: int = 256
    raw: bool = False
    drives: str = ""
    normal_maps: str = ""
    roughness_maps: str = ""
    fallback_size: int = 2048
    jobs: int = field(default_factory=lambda: os.cpu_count() or 1)

    @property
    def driven(self) -> str:
        """The input of the surface, with its default."""
        return self.drives or ("roughness" if self.raw else "diffuseColor")

    @property
    def is_data(self) -> bool:
        """Whether the inputs' values are stored as they are."""
        return self.raw or self.driven not in _COLOR_INPUTS

    @property
    def arrange(self) -> ArrangeOptions:
        """What `fexel_tools.umbrella_arrange` is told."""
        return ArrangeOptions(
            grid=self.grid,
            count=self.count,
            layers=self.layers,
            placement=self.arrangement,
            size=self.size,
            rotation=self.rotation,
            morph=(0.0, self.morph if "shape" in self.diversify else 0.0),
            order=self.order,
            seed=self.seed,
        )


def check_options(options: UmbrellaOptions) -> None:
    """Find wrong options before any work is done; those of the arrangement `check_arrange_options` looks at.

    Raises
    ------
    FexelError
        Naming the option, what it is and what was expected.
    """
    for name, value, choices in (
        ("--kind", options.kind, KINDS),
        ("--levels", options.levels, LEVELS),
        ("--drives", options.driven, DRIVEN),
    ):
        if value not in choices:
            raise FexelError(f"{name}: '{value}' is unknown, expected one of {', '.join(choices)}")
    for name, value, low, high in (
        ("--grid", max(options.grid), 1, MOST_CELLS),
        ("--vertices", options.vertices, *_VERTICES),
        ("--texture-size", options.texture_size, *_TEXTURE_SIZES),
        ("--background-size", options.background_size, 1, 1024),
        ("--color-blend", options.color_blend, 0.0, 1.0),
        ("--morph", options.morph, 0.0, 1.0),
        ("--shadow-strength", options.shadow_strength, 0.0, 1.0),
        ("--fallback-size", options.fallback_size, 1, 16384),
        ("--jobs", options.jobs, 1, 1024),
    ):
        if not low <= value <= high:  # also refuses NaN
            raise FexelError(f"{name}: {value:g}, expected {low:g} to {high:g}")
    if not (np.isfinite(options.tolerance) and options.tolerance > 0.0):
        raise FexelError(f"--tolerance: {options.tolerance:g}, expected a number of pixels above 0")
    if not np.isfinite(options.shadow).all():
        raise FexelError(f"--shadow: {options.shadow}, expected finite numbers of cells")
    if options.raw and options.drives in _COLOR_INPUTS:
        raise FexelError(f"--raw: data cannot drive {options.drives}, which takes colours")
    _check_files(options)


def read_files(options: UmbrellaOptions) -> list[str]:
    """Files that are read besides the photos: hints, references, background, a table of places."""
    background = options.background if isinstance(options.background, str) else ""
    named = (options.hints, *options.references, background, options.arrangement.split(":/", 1)[0])
    return [file for file in named if file and Path(file).is_file()]


def _check_files(options: UmbrellaOptions) -> None:
    for name, file in (("--hints", options.hints), *(("--references", file) for file in options.references)):
        if file and not Path(file).is_file():
            raise FexelError(f"{name}: {file}: no such file")
    background = options.background
    if isinstance(background, str) and background not in (AUTO, NONE) and not Path(background).is_file():
        found = "is a folder" if Path(background).is_dir() else "no such file"
        raise FexelError(f"--background: {background}: {found}, expected an image, #rrggbb, {AUTO} or {NONE}")
    for name, folder, drives in (
        ("--normal-maps", options.normal_maps, "normal"),
        ("--roughness-maps", options.roughness_maps, "roughness"),
    ):
        if folder and not Path(folder).is_dir():
            raise FexelError(f"{name}: {folder}: no such folder")
        if folder and options.driven == drives:
            raise FexelError(f"{name}: the inputs drive the {drives} already")
