"""The demonstration of minification: two stages with plain textures, each filter over them, and what would be right.

`fexel minify` writes a layer per filter that a stage may name; `ewa` and `auto` are asked of the renderer. What is
right is the mean of many pixels of a picture that is several times finer, in linear light.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

import fexel
from fexel.errors import FexelError
from fexel.filters import FILTERS, PORTABLE_FILTERS
from fexel.images import linear_to_srgb
from fexel_tools.contact_sheet import SheetRow, caption_strip, contact_sheet, write_png
from fexel_tools.minify import MinifyOptions, minify

__all__ = ["ABOUT", "FilterFigures", "FipmapDemo", "View", "bundled_views", "make_fipmap_demo", "run"]

ABOUT = "minification filters at grazing view, beside what would be right"

_ENLARGED = 2  # pixels of the sheet along a pixel
_FINER = 8  # pixels of the truth along a pixel
_FINE_FILTER, _FINE_PROBES = "anisotropic", 16  # of these; a fipmap there would be the same to 60 dB, EWA to 51
_CAPTION_PX = 18
_BACKGROUND = (0.3, 0.45, 0.7)  # linear


@dataclass(frozen=True)
class View:
    """A square part of what a camera of a stage sees.

    Attributes
    ----------
    name : str
    stage : Path
    camera : str
    frame : (float, float)
        Width and height of the whole picture, over the part's.
    corner : (float, float)
        Upper left of the part, from the left and the top, in widths of the part.
    """

    name: str
    stage: Path
    camera: str
    frame: tuple[float, float]
    corner: tuple[float, float]


@dataclass(frozen=True)
class FilterFigures:
    """How good a filter is at a view, and what it costs.

    Attributes
    ----------
    psnr_db : float
        Against what would be right, sRGB-encoded.
    fetches : float
        Texels fetched per pixel, on average.
    """

    psnr_db: float
    fetches: float


@dataclass(frozen=True)
class FipmapDemo:
    """What `make_fipmap_demo` wrote.

    Attributes
    ----------
    layers : tuple of Path
        A layer per view and filter that a stage may name.
    sheet : Path
        PNG: a row per view, a column per filter, and what would be right.
    figures : dict of (view, filter) to FilterFigures
    """

    layers: tuple[Path, ...]
    sheet: Path
    figures: dict[tuple[str, str], FilterFigures]


def run(options: argparse.Namespace) -> str:
    """The part of `demo`: `make_fipmap_demo` of what is bundled; where the results are."""
    result = make_fipmap_demo(bundled_views(), options.output, options.width)
    return f"layers {result.layers[0]} and others, beside what would be right in {result.sheet}"


def bundled_views() -> list[View]:
    """Holbein's skull and the floor of line pairs, which come with a checkout.

    Raises
    ------
    FexelError
        They are not there, as in an installed wheel.
    """
    stages = Path(__file__).resolve().parents[2] / "stages"
    skull, floor = (stages / name / f"{name}.usda" for name in ("fipmap_anamorphosis", "fipmap_floor"))
    for stage in (skull, floor):
        if not stage.is_file():
            raise FexelError(f"{stage}: no such stage; it comes with a checkout")
    return [
        View("Holbein's skull", skull, "Detail", (5 / 3, 5 / 3), (0.46, 0.42)),
        View("line pairs on a floor", floor, "Detail", (2.0, 1.125), (0.5, 0.125)),
    ]


def make_fipmap_demo(views: Sequence[View], output: Path, width: int, tokens: Sequence[str] = FILTERS) -> FipmapDemo:
    """Give stages one filter after the other and render them.

    Parameters
    ----------
    views : sequence of View
    output : Path
        Folder, made if need be. Gets ``<stage>_<filter>.usda`` and ``fipmap_sheet.png``.
    width : int
        Of a picture on the sheet, pixels; each of its own pixels is enlarged, so that it can be judged.
    tokens : sequence of str
        Of `fexel.filters.FILTERS`.

    Raises
    ------
    FexelError
        An unreadable stage, no OpenGL, a folder that cannot be written.
    """
    output.mkdir(parents=True, exist_ok=True)
    size = max(8, width // _ENLARGED)
    with fexel.Renderer(filter=_FINE_FILTER, anisotropy=_FINE_PROBES) as renderer:
        truths = {view.name: _truth(renderer, view, size) for view in views}
    layers: list[Path] = []
    pictures: dict[str, list[NDArray[np.float32]]] = {view.name: [] for view in views}
    figures: dict[tuple[str, str], FilterFigures] = {}
    for token in tokens:
        portable = token in PORTABLE_FILTERS
        with fexel.Renderer(filter=None if portable else token) as renderer:
            for view in views:
                stage = _layer(view, token, output) if portable else view.stage
                layers += [stage] if portable else []
                picture, fetches = _picture(renderer, view, stage, size)
                pictures[view.name].append(picture)
                figures[view.name, token] = FilterFigures(_psnr_db(picture, truths[view.name]), fetches)
    rows = [SheetRow(view.name, _panels(view, pictures[view.name], truths[view.name], figures)) for view in views]
    sheet = output / "fipmap_sheet.png"
    write_png(sheet, contact_sheet(rows, [*tokens, f"mean of {_FINER} x {_FINER} finer pixels"]))
    return FipmapDemo(tuple(layers), sheet, figures)


def _layer(view: View, token: str, output: Path) -> Path:
    """The stage with a filter, as the command writes it."""
    layer = output / f"{view.stage.stem}_{token}.usda"
    minify(view.stage, layer, MinifyOptions(filter=token))
    return layer


def _panels(
    view: View,
    pictures: Sequence[NDArray[np.float32]],
    truth: NDArray[np.float32],
    figures: dict[tuple[str, str], FilterFigures],
) -> list[NDArray[np.uint8]]:
    """Pictures with their error and cost below, and what would be right."""
    own = [found for (name, _), found in figures.items() if name == view.name]
    captions = [f"{found.psnr_db:.1f} dB, {found.fetches:.0f} texels a pixel" for found in own]
    panels = []
    for picture, caption in zip((*pictures, truth), (*captions, ""), strict=True):
        enlarged = _enlarged(picture)
        panels.append(np.concatenate([enlarged, caption_strip(enlarged.shape[1], _CAPTION_PX, (caption,))]))
    return panels


def _picture(renderer: fexel.Renderer, view: View, stage: Path, size: int) -> tuple[NDArray[np.float32], float]:
    """(size, size, 3) sRGB-encoded, and texels fetched per pixel that shows the main texture."""
    images = _rendered(renderer, view, stage, size, 1, ("color", "fetches"))
    fetches = images["fetches"][..., 0]
    return _encoded(images["color"]), float(fetches[fetches > 0].mean()) if (fetches > 0).any() else 0.0


def _truth(renderer: fexel.Renderer, view: View, size: int) -> NDArray[np.float32]:
    """The mean, in linear light, of a picture that is `_FINER` times as fine."""
    color = _rendered(renderer, view, view.stage, size, _FINER, ("color",))["color"]
    return _encoded(color.reshape(size, _FINER, size, _FINER, 4).mean((1, 3)))


def _rendered(
    renderer: fexel.Renderer, view: View, stage: Path, size: int, finer: int, aovs: tuple[str, ...]
) -> dict[str, NDArray[np.float32]]:
    """The view's part of every AOV, (size, size, C), or so many times as fine."""
    width, height = (finer * round(share * size) for share in view.frame)
    left, top = (finer * round(share * size) for share in view.corner)
    opened = Usd.Stage.Open(str(stage))
    whole = renderer.render(opened, camera=view.camera, width=width, height=height, aovs=aovs)
    return {name: image[top : top + finer * size, left : left + finer * size] for name, image in whole.items()}


def _encoded(color: NDArray[np.float32]) -> NDArray[np.float32]:
    """sRGB-encoded, in [0, 1], before the background."""
    linear = color[..., :3] + (1 - color[..., 3:]) * np.array(_BACKGROUND, np.float32)
    return linear_to_srgb(np.clip(linear, 0, 1))


def _enlarged(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.round(255 * picture).astype(np.uint8).repeat(_ENLARGED, 0).repeat(_ENLARGED, 1)


def _psnr_db(picture: NDArray[np.float32], truth: NDArray[np.float32]) -> float:
    error = float(np.mean((picture.astype(np.float64) - truth) ** 2))
    return float(-10 * np.log10(max(error, 1e-12)))  # 120 dB where they are the same
