"""``fexel filters``: all filters on images, in a fan of views, with a sheet to look at and a report to choose by.

::

    {"images": [{"image", "size": [w, h], "window": [left, top, right, bottom], "wrap", "white"}],
     "pixels": {"box", "gauss"}, "minor_axis",
     "views": [{"image", "elevation", "azimuth", "filter", "truth": "box" | "gauss", "psnr_db", "ciede2000", "fetches",
                "memory"}]}

`size` is that of the file, `window` the part of it that was looked at; `white` the linear value that counts as 1 (above
1 only in images that are brighter). Elevations and azimuths are degrees; every pixel of a view has the same footprint,
`minor_axis` texels wide. `psnr_db` is of sRGB-encoded values over white against a peak of 1, at most 100; `ciede2000`
the mean colour difference; of data (``--raw``, ``--normal-map``) values are compared as they are and `ciede2000` is
null. Truths are the mean over the pixel's preimage (`box`) and one weighted by a Gaussian of half a pixel's standard
deviation (`gauss`), of as many pixels as `pixels` says. `fetches` is texels per pixel, `memory` the texels of all that
the filter may read, as a multiple of the image's. Filters are those of `fexel.filters`, and ``fipmap-gauss``: the
fipmap as ``fexel render --filterKernel gauss`` draws it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fexel.errors import FexelError
from fexel_tools.filter_measure import COMPARED, GAUSS_FIPMAP, GAUSS_PIXELS, Measured, measure
from fexel_tools.filter_sheet import SheetPart, write_sheet
from fexel_tools.filter_subject import WRAPS, Subject, open_subject
from fexel_tools.filter_views import AZIMUTHS, MINOR, FilterView, check_angles, fan
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report

__all__ = ["FilterOptions", "FilterReport", "compare_filters", "summary"]


@dataclass(frozen=True)
class FilterOptions:
    """What to compare.

    Attributes
    ----------
    elevations, azimuths : tuple of float
        Degrees; a view for every pair.
    filters : tuple of str
        Of `fexel_tools.filter_measure.COMPARED`.
    pixels : int
        Side of the pictures, 16 to 512.
    texels : int
        Most texels a side that are taken of an image, from its middle.
    wrap : str
        How images go on beyond their border.
    anisotropy : float
        Most probes of ``anisotropic``.
    raw, normal_map : bool
        Images hold data; vectors.
    """

    elevations: tuple[float, ...] = (90.0, 45.0, 20.0, 10.0, 5.0, 2.0, 1.0)
    azimuths: tuple[float, ...] = AZIMUTHS[::2]
    filters: tuple[str, ...] = COMPARED
    pixels: int = 128
    texels: int = 1024
    wrap: str = "repeat"
    anisotropy: float = 16.0
    raw: bool = False
    normal_map: bool = False


@dataclass(frozen=True, eq=False)
class FilterReport:
    """All figures; see the module for the JSON."""

    subjects: tuple[Subject, ...]
    pixels: int
    figures: tuple[Measured, ...]

    def as_json(self) -> dict[str, Any]:
        """The whole report."""
        return {
            "images": [_about(subject) for subject in self.subjects],
            "pixels": {"box": self.pixels**2, "gauss": min(self.pixels**2, GAUSS_PIXELS)},
            "minor_axis": MINOR,
            "views": [_entry(figure) for figure in self.figures],
        }


def compare_filters(
    files: Sequence[str | Path],
    options: FilterOptions = FilterOptions(),
    *,
    sheet: str | Path | None = None,
    report: str | Path | None = None,
    progress: Progress = silent,
) -> FilterReport:
    """Measure filters on images.

    Parameters
    ----------
    files : sequence of str or Path
    options : FilterOptions
    sheet : str or Path, optional
        PNG to write: truth, filters and error maps.
    report : str or Path, optional
        JSON to write.
    progress : Progress

    Raises
    ------
    FexelError
        A wrong option, a file that cannot be read or written; nothing is written then.
    """
    _check(files, options, sheet, report)
    views = fan(options.elevations, options.azimuths)
    subjects, figures, parts = [], [], []
    for file in files:
        with tempfile.TemporaryDirectory(prefix="fexel-filters-") as folder:
            subject = _opened(str(file), Path(folder), options)
            found, pictures = measure(
                subject,
                views,
                options.filters,
                pixels=options.pixels,
                anisotropy=options.anisotropy,
                keep=_shown(options) if sheet is not None else (),
                progress=progress,
            )
        subjects.append(subject)
        figures += found
        parts.append(SheetPart(subject, found, pictures))
    result = FilterReport(tuple(subjects), options.pixels, tuple(figures))
    if sheet is not None:
        write_sheet(parts, sheet)
    if report is not None:
        write_report(result, report)
    return result


def summary(report: FilterReport) -> list[str]:
    """A table for the terminal: filters over elevations, PSNR in dB against the box truth (of Gaussians, theirs)."""
    elevations = sorted({figure.view.elevation for figure in report.figures}, reverse=True)
    filters = list(dict.fromkeys(figure.filter for figure in report.figures))
    lines = [f"{'filter':12}{'fetches':>9}{'memory':>8}" + "".join(f"{e:>7g}" for e in elevations) + "  degrees: dB"]
    for token in filters:
        truth = "gauss" if token == GAUSS_FIPMAP else "box"
        own = [figure for figure in report.figures if figure.filter == token and figure.truth == truth]
        cells = [np.mean([f.psnr_db for f in own if f.view.elevation == elevation]) for elevation in elevations]
        fetches, memory = np.mean([f.fetches for f in own]), np.mean([f.memory for f in own])
        lines.append(f"{token:12}{fetches:9.1f}{memory:8.2f}" + "".join(f"{cell:7.1f}" for cell in cells))
    return lines


def _opened(file: str, folder: Path, options: FilterOptions) -> Subject:
    return open_subject(
        file, folder, largest=options.texels, wrap=options.wrap, raw=options.raw, vectors=options.normal_map
    )


def _shown(options: FilterOptions) -> tuple[FilterView, ...]:
    """Views for the sheet: every elevation at the azimuth that suits plain ripmaps least."""
    azimuth = min(options.azimuths, key=lambda angle: abs(angle % 90 - 30))
    return fan(options.elevations, (azimuth,))


def _check(
    files: Sequence[str | Path], options: FilterOptions, sheet: str | Path | None, report: str | Path | None
) -> None:
    if not files:
        raise FexelError("filters: no image given, expected at least one")
    check_angles(options.elevations, options.azimuths)
    for token in options.filters:
        if token not in COMPARED:
            raise FexelError(f"--filters: '{token}', expected some of {', '.join(COMPARED)}")
    if not options.filters:
        raise FexelError(f"--filters: none given, expected some of {', '.join(COMPARED)}")
    if options.wrap not in WRAPS:
        raise FexelError(f"--wrap: '{options.wrap}', expected one of {', '.join(WRAPS)}")
    limits = (
        ("--size", options.pixels, 16, 512),
        ("--texels", options.texels, 16, 8192),
        ("--anisotropy", options.anisotropy, 1, 64),
    )
    for name, value, least, most in limits:
        if not least <= value <= most:
            raise FexelError(f"{name}: {value:g}, expected {least} to {most}")
    if sheet is not None:
        check_report(sheet, [*files, *([report] if report else [])], "sheet")
        if Path(sheet).suffix.lower() != ".png":
            raise FexelError(f"{sheet}: the sheet is '{Path(sheet).suffix}', expected .png")
    if report is not None:
        check_report(report, files)


def _about(subject: Subject) -> dict[str, Any]:
    return {
        "image": subject.name,
        "size": list(subject.file_size),
        "window": list(subject.window),
        "wrap": subject.source.wrap[0],
        "white": subject.white,
    }


def _entry(figure: Measured) -> dict[str, Any]:
    return {
        "image": figure.image,
        "elevation": figure.view.elevation,
        "azimuth": figure.view.azimuth,
        "filter": figure.filter,
        "truth": figure.truth,
        "psnr_db": round(figure.psnr_db, 3),
        "ciede2000": None if figure.ciede2000 is None else round(figure.ciede2000, 4),
        "fetches": round(figure.fetches, 3),
        "memory": round(figure.memory, 4),
    }
