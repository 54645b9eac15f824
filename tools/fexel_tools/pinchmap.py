"""An image or SVG to a pinchmap stage: the whole way, section 7 of Tarini and Cignoni 2005, *Pinchmaps*.

Steps 1 to 3 are put together in `pinchmap_solution`, the others here.

1. `pinchmap_source`: colour, opacity, and which side of the lines every pixel is on.
2. `pinchmap_fit`: the mask, legal and as near to the source as the map allows, and gamma, which bends its lines.
3. `pinchmap_signal`: pinch strength, so that lines fade where the source does; the signal, never mixing sides.
4. `pinchmap_textures`, `pinchmap_stage`, `fallback`: files, prims, and the picture for other applications; all at once.
5. `pinchmap_measure`: how well it fits, if a report or a sheet is asked for.

Many files: `pinchmap_folder`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from fexel.errors import FexelError
from fexel_tools import fallback, pinchmap_stage
from fexel_tools.phases import Phases
from fexel_tools.pinchmap_advice import suggested_size
from fexel_tools.pinchmap_measure import measure_shape, psnr_db
from fexel_tools.pinchmap_options import PinchmapOptions, check_options
from fexel_tools.pinchmap_range import scaled, value_range
from fexel_tools.pinchmap_report import PinchmapItem, PinchmapReport
from fexel_tools.pinchmap_sheet import Panels, draw_panels, plain_texture, premultiplied, seen, write_sheet
from fexel_tools.pinchmap_solution import STEPS, Pinchmap, compute_pinchmap
from fexel_tools.pinchmap_textures import write_pinchmap, write_signal
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report
from fexel_tools.staged_output import check_output, staged_output

__all__ = ["AuthoredPinchmap", "Pinchmap", "author_pinchmap", "compute_pinchmap", "make_pinchmap"]

SHEET_PX = 480  # longer side of a picture in the sheet of one file


@dataclass(frozen=True, eq=False)
class AuthoredPinchmap:
    """What became of one file, and its pictures for a sheet where those were asked for."""

    item: PinchmapItem
    panels: Panels | None = None


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
    check_report(sheet, [*others, *([report] if report is not None else [])], "sheet")


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
    phases = Phases("pinchmap", STEPS, progress or silent)
    pinchmap = compute_pinchmap(file, options, phases)
    nbytes = _write(pinchmap, file, out, options, phases)
    with phases("measure"):
        item = _item(pinchmap, file, out, nbytes, measured)
        panels = draw_panels(pinchmap, item, panel_px, square=square_panels) if panel_px else None
    return AuthoredPinchmap(replace(item, seconds=phases.authoring, phases=phases.seconds), panels)


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
            stage.GetRootLayer().Save()  # the fallback adds its network
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
        has_lines=bool(pinchmap.fit.mask.any() and not pinchmap.fit.mask.all()),
        suggested_size=suggested_size(source.side, pinchmap.fit.faults, pinchmap.size, pinchmap.texel_px),
    )
    if not measured:
        return item
    shape = measure_shape(pinchmap.texels, source.side, pinchmap.wrap, window=pinchmap.fit.window)
    span = value_range(source)
    truth = scaled(premultiplied(source), span)
    result = scaled(pinchmap.picture((height, width)), span)
    plain = seen(plain_texture(truth, nbytes, pinchmap.has_alpha, source.is_data), (width, height))
    psnr, plain_psnr = (psnr_db(picture, truth, encode=not source.is_data) for picture in (result, plain))
    return replace(item, **shape.as_dict(), psnr_db=psnr, plain_psnr_db=plain_psnr)
