"""An image or SVG to a pinchmap stage: the whole way, section 7 of Tarini and Cignoni 2005, *Pinchmaps*.

1. `pinchmap_source`: colour, opacity, and which side of the lines every pixel is on.
2. `pinchmap_fit`: the mask, legal and as near to the source as the map allows, and gamma, which bends its lines.
3. `pinchmap_signal`: pinch strength, so that lines fade where the source does; the signal, never mixing sides.
4. `pinchmap_textures`, `pinchmap_stage`, `fallback`: files, prims, and the picture for other applications; all at once.
5. `pinchmap_measure`: how well it fits, if a report or a sheet is asked for.

Many files: `pinchmap_folder`.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fexel.errors import FexelError
from fexel_tools import fallback, pinchmap_stage
from fexel_tools.pinchmap_advice import suggested_size
from fexel_tools.pinchmap_auto import largest_auto_size, smallest_size
from fexel_tools.pinchmap_baking import WHOLE, reconstruct
from fexel_tools.pinchmap_fit import PinchmapFit, fit
from fexel_tools.pinchmap_ink import clear_of_lines
from fexel_tools.pinchmap_measure import measure_shape, mismatch, psnr_db, side_of_pixels
from fexel_tools.pinchmap_options import AUTO, PinchmapOptions, check_options, map_shape
from fexel_tools.pinchmap_report import PinchmapItem, PinchmapReport
from fexel_tools.pinchmap_sheet import Panels, draw_panels, plain_texture, premultiplied, seen, write_sheet
from fexel_tools.pinchmap_signal import fill_signal
from fexel_tools.pinchmap_source import PinchmapSource, load_source
from fexel_tools.pinchmap_strength import boundary_strength
from fexel_tools.pinchmap_textures import as_stored, write_pinchmap, write_signal
from fexel_tools.pinchmap_window import Window, choose_window, cut, matrix_of, roomy
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report
from fexel_tools.staged_output import check_output, staged_output

__all__ = ["AuthoredPinchmap", "Pinchmap", "author_pinchmap", "compute_pinchmap", "make_pinchmap"]

SHEET_PX = 480  # longer side of a picture in the sheet of one file
_STEPS = ("read", "fit", "signal", "textures", "fallback", "stage", "measure")
_FIT_BITS = {"8": 8, "16": 16, "float": 32}


@dataclass(frozen=True, eq=False)
class Pinchmap:
    """A pinchmap as computed, not yet written.

    Attributes
    ----------
    source : PinchmapSource
    size : int
        Texels along the longer side.
    fit : PinchmapFit
    texels : (Nh, Nw, 4) float64
        The pinchmap as a renderer reads it from its file.
    signal : (Sh, Sw, 4) float32
        Linear (or data), straight alpha.
    wrap : (str, str)
    st_to_texture : (3, 3) float64
        From st of the source to the pinchmap's own, which covers what is to be seen of it; row vectors.
    """

    source: PinchmapSource
    size: int
    fit: PinchmapFit
    texels: np.ndarray
    signal: np.ndarray
    wrap: tuple[str, str]
    st_to_texture: np.ndarray

    @property
    def has_alpha(self) -> bool:
        """Whether anything is seen through the source."""
        return bool((self.source.opacity < 1.0).any())

    @property
    def texel_px(self) -> float:
        """Longer side of its texels in pixels of the source."""
        left, top, right, bottom = self.fit.window
        return max((right - left) / self.texels.shape[1], (bottom - top) / self.texels.shape[0])

    @property
    def detail_st(self) -> np.ndarray | None:
        """(4, 2) corners of where its lines are busiest, in st of the source; None where it has none."""
        return pinchmap_stage.busiest_window(self.fit.mask, self.st_to_texture)

    def picture(self, shape: tuple[int, int], window: tuple[float, float, float, float] = WHOLE) -> np.ndarray:
        """(rows, columns, 4) float32, linear, premultiplied: a window (s0, t0, s1, t1) of the source as it is shown."""
        return reconstruct(self.texels, self.signal, shape, self.wrap, window=window, st_to_texture=self.st_to_texture)


@dataclass(frozen=True, eq=False)
class AuthoredPinchmap:
    """What became of one file, and its pictures for a sheet where those were asked for."""

    item: PinchmapItem
    panels: Panels | None = None


@dataclass
class Phases:
    """Seconds on the clock by phase."""

    seconds: dict[str, float] = field(default_factory=dict)
    progress: Progress = silent

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Time what is done inside."""
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.progress("pinchmap", _STEPS.index(name) + 1, len(_STEPS))


def make_pinchmap(
    file: str,
    out: str | Path,
    options: PinchmapOptions | None = None,
    *,
    report: str | Path | None = None,
    sheet: str | Path | None = None,
    progress: Progress | None = None,
) -> PinchmapItem:
    """Author a pinchmap stage from an image or SVG.

    Parameters
    ----------
    file : str
        SVG, or any format that OpenImageIO reads.
    out : str or Path
        ``.usda``, ``.usdc`` or ``.usd``; textures go to the folder ``<stem>_textures`` beside it.
    options : PinchmapOptions, optional
    report : str or Path, optional
        JSON file, see `fexel_tools.pinchmap_report`.
    sheet : str or Path, optional
        PNG: original, result, plain texture of equal bytes, error, and the places where the map falls short.
    progress : callable(step, done, total), optional

    Returns
    -------
    PinchmapItem

    Raises
    ------
    FexelError
        A file is missing or unusable, an option is wrong, or an output cannot be written. Nothing is written then.

    Examples
    --------
    >>> make_pinchmap("logo.svg", "logo.usda").iou  # doctest: +SKIP
    0.9961
    """
    options = options or PinchmapOptions()
    inputs = check_input(file, options)
    check_output(out, inputs)
    check_side_outputs(report, sheet, [out, *inputs])
    measured = report is not None or sheet is not None
    authored = author_pinchmap(
        file, out, options, measured=measured, panel_px=SHEET_PX if sheet else 0, progress=progress
    )
    if report is not None:
        write_report(PinchmapReport((authored.item,)), report)
    if sheet is not None:
        write_sheet([authored.panels] if authored.panels else [], sheet)
    return authored.item


def check_input(file: str, options: PinchmapOptions) -> list[str]:
    """Find out what can be known to fail before any work is done; returns the files that are read.

    Raises
    ------
    FexelError
        As `make_pinchmap`.
    """
    check_options(options)
    if not Path(file).exists():
        raise FexelError(f"{file}: no such file")
    if Path(file).is_dir():
        raise FexelError(f"{file}: is a folder, expected an image or SVG")
    labels = [options.regions] if options.regions and Path(options.regions).is_file() else []
    return [file, *labels, *([options.mask] if options.mask else [])]


def check_side_outputs(report: str | Path | None, sheet: str | Path | None, others: list[str | Path]) -> None:
    """See to it, before any work, that report and sheet can be written and replace nothing.

    Raises
    ------
    FexelError
        As `report.check_report`; or the sheet is no PNG.
    """
    if report is not None:
        check_report(report, others)
    if sheet is None:
        return
    if Path(sheet).suffix.lower() != ".png":
        raise FexelError(f"{sheet}: the sheet is a '{Path(sheet).suffix}', expected a .png")
    check_report(sheet, [*others, *([report] if report is not None else [])])


def author_pinchmap(
    file: str,
    out: str | Path,
    options: PinchmapOptions,
    *,
    measured: bool = True,
    panel_px: int = 0,
    square_panels: bool = False,
    progress: Progress | None = None,
) -> AuthoredPinchmap:
    """Compute a pinchmap, write its stage, and measure it. Arguments are as `make_pinchmap` has checked them.

    Parameters
    ----------
    file, out, options, progress
        As for `make_pinchmap`.
    measured : bool
        Whether distances, IoU and PSNR are wanted; without them `mean_px`, `max_px` and `psnr_db` are None.
    panel_px : int
        Longer side of the pictures for a sheet; 0 makes none.
    square_panels : bool
        As for a sheet of many files.
    """
    phases = Phases(progress=progress or silent)
    pinchmap = compute_pinchmap(file, options, phases)
    nbytes = _write(pinchmap, file, out, options, phases)
    seconds = sum(phases.seconds.values())
    with phases("measure"):
        item = _item(pinchmap, file, out, nbytes, measured)
        panels = draw_panels(pinchmap, item, panel_px, square=square_panels) if panel_px else None
    return AuthoredPinchmap(replace(item, seconds=seconds, phases=phases.seconds), panels)


def compute_pinchmap(file: str, options: PinchmapOptions, phases: Phases | None = None) -> Pinchmap:
    """From a source to the texels of pinchmap and signal.

    Parameters
    ----------
    file : str
    options : PinchmapOptions
    phases : Phases, optional
        Is told how long reading, fitting and filling take.

    Raises
    ------
    FexelError
        The source cannot be used.
    """
    phases = phases or Phases()
    with phases("read"):
        source = load_source(
            file,
            size=None if options.size == AUTO else (int(options.size), int(options.size)),
            regions=options.regions or None,
            mask=options.mask or None,
            raw=options.is_data,
            seed=options.seed,
        )
    with phases("fit"):
        size, fitted = _fit(source, options)
    with phases("signal"):
        finer = _signal_ratio(size, options)
        shape = (fitted.pinchmap.shape[0] * finer, fitted.pinchmap.shape[1] * finer)
        seen = _cut(source, fitted.window)
        texels = fitted.pinchmap.copy()
        texels[..., :2] *= boundary_strength(seen.side, texels, shape, wrap=options.wrap)[..., None]
        texels = as_stored(texels, options.bits)
        signal = fill_signal(seen, texels, shape, wrap=options.wrap)
    matrix = matrix_of(fitted.window, source.side.shape)
    return Pinchmap(source, size, fitted, texels, signal, options.wrap, matrix)


def _fit(source: PinchmapSource, options: PinchmapOptions) -> tuple[int, PinchmapFit]:
    height, width = source.side.shape
    # A line is as wide as the texels are, which cropping would stretch.
    content = None if options.line_width > 0.0 else source.opacity > 0.0
    # What repeats or is mirrored outside of the map must be the whole picture.
    tiled = ("clamp" if options.wrap[0] == "clamp" else "repeat", "clamp" if options.wrap[1] == "clamp" else "repeat")

    def attempt(size: int) -> PinchmapFit:
        shape = map_shape(width, height, size)
        window = choose_window(source.side, shape, wrap=tiled, content=content)
        fitted = _fit_window(source.side, shape, roomy(window, shape, source.side.shape), options)
        return _with_room_for_lines(fitted, source, options) if options.line_width > 0.0 else fitted

    if options.size == AUTO:
        return smallest_size(attempt, options.tolerance, largest_auto_size(width, height), str(source.path))
    size = int(options.size)
    return size, attempt(size)


def _fit_window(side: np.ndarray, shape: tuple[int, int], window: Window, options: PinchmapOptions) -> PinchmapFit:
    """Fit to the window and a cell around it; what lies further out is transparent and stays on its side."""
    height, width = side.shape
    margin = -(-(window[2] - window[0]) // shape[1]), -(-(window[3] - window[1]) // shape[0])
    x0, y0 = max(window[0] - margin[0], 0), max(window[1] - margin[1], 0)
    part = np.ascontiguousarray(side[y0 : min(window[3] + margin[1], height), x0 : min(window[2] + margin[0], width)])
    moved = (window[0] - x0, window[1] - y0, window[2] - x0, window[3] - y0)
    bits = _FIT_BITS[options.bits]
    fitted = fit(part, shape, wrap=options.wrap, seed=options.seed, bits=bits, window=moved)
    faults = tuple(replace(fault, x=fault.x + x0, y=fault.y + y0) for fault in fitted.faults)
    return replace(fitted, mismatch=fitted.mismatch * part.size / side.size, window=window, faults=faults)


def _with_room_for_lines(fitted: PinchmapFit, source: PinchmapSource, options: PinchmapOptions) -> PinchmapFit:
    pinchmap = clear_of_lines(fitted.pinchmap, options.line_width)
    result = side_of_pixels(pinchmap, source.side.shape, options.wrap, window=fitted.window)
    return replace(fitted, pinchmap=pinchmap, mismatch=mismatch(result, source.side))


def _cut(source: PinchmapSource, window: Window) -> PinchmapSource:
    """The part of a source that its pinchmap covers."""
    height, width = source.side.shape
    if tuple(window) == (0, 0, width, height):
        return source
    color, opacity, side = (cut(plane, window) for plane in (source.color, source.opacity, source.side))
    return replace(source, color=color, opacity=opacity, side=side)


def _signal_ratio(size: int, options: PinchmapOptions) -> int:
    """2^K; the largest that `signal_size` allows."""
    return 1 << max(0, (options.signal_size // size).bit_length() - 1)


def _write(pinchmap: Pinchmap, file: str, out: str | Path, options: PinchmapOptions, phases: Phases) -> int:
    """Everything into its place; returns the bytes of the texels."""
    with staged_output(out) as staged:
        with phases("textures"):
            map_path, map_bytes = write_pinchmap(staged.textures, pinchmap.texels, options.bits)
            signal = write_signal(
                staged.textures,
                pinchmap.signal,
                pinchmap.source.bits,
                is_data=pinchmap.source.is_data,
                has_alpha=pinchmap.has_alpha,
            )
        with phases("stage"):
            height, width = pinchmap.source.side.shape
            prim = pinchmap_stage.PinchmapPrim(
                file=f"./{staged.textures.name}/{signal.path.name}",
                pinchmap=f"./{staged.textures.name}/{map_path.name}",
                source_color_space=signal.color_space,
                drives=options.driven,
                has_alpha=pinchmap.has_alpha,
                is_biased=options.driven == "normal" and bool((pinchmap.source.color >= 0.0).all()),
                wrap=options.wrap,
                antialias=options.antialias,
                line_width=options.line_width,
                line_color=options.line_color,
                source=Path(file).name,
                matrix=pinchmap.st_to_texture,
            )
            stage = pinchmap_stage.create_stage(staged.stage, prim, width / height, pinchmap.detail_st)
        with phases("fallback"):
            texture = stage.GetPrimAtPath(pinchmap_stage.TEXTURE_PATH)
            fallback.write_fallback(texture, staged.textures / "fallback.png", options.fallback_size)
        with phases("stage"):
            stage.GetRootLayer().Save()
    return map_bytes + signal.nbytes


def _item(pinchmap: Pinchmap, file: str, out: str | Path, nbytes: int, measured: bool) -> PinchmapItem:
    source = pinchmap.source
    height, width = source.side.shape
    item = PinchmapItem(
        file=file,
        size=pinchmap.size,
        nbytes=nbytes,
        iou=None,
        mismatch=pinchmap.fit.mismatch,
        mean_px=None,
        max_px=None,
        psnr_db=None,
        seconds=0.0,
        stage=str(out),
        pinchmap=(pinchmap.texels.shape[1], pinchmap.texels.shape[0]),
        signal=(pinchmap.signal.shape[1], pinchmap.signal.shape[0]),
        source=(width, height),
        faults=pinchmap.fit.faults,
        suggested_size=suggested_size(source.side, pinchmap.fit.faults, pinchmap.size, pinchmap.texel_px),
    )
    if not measured:
        return item
    shape = measure_shape(pinchmap.texels, source.side, pinchmap.wrap, window=pinchmap.fit.window)
    truth = premultiplied(source)
    plain = seen(plain_texture(truth, nbytes, pinchmap.has_alpha, source.is_data), (width, height))
    psnr, plain_psnr = (
        psnr_db(picture, truth, encode=not source.is_data) for picture in (pinchmap.picture((height, width)), plain)
    )
    return replace(item, **shape.as_dict(), psnr_db=psnr, plain_psnr_db=plain_psnr)
