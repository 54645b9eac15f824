"""SVG drawings as pixels: any size, straight alpha, nothing outside the file read.

The drawing is parsed and cleaned here (`xml.etree`, which expands entities with limits and never opens a URL), then
drawn by resvg (through resvg-py), which of the libraries with wheels for all systems and no system package follows the
static part of SVG most completely: style sheets, ``use`` and ``symbol``, markers, masks, patterns, filters.

What counts as the picture is the viewport: ``width`` by ``height``, else the ``viewBox``; without either what is
drawn. Declared sizes only give the aspect. ``currentColor`` is the root's ``color``, else black. Images are drawn where
they are embedded (``data:``); references to other files and to the network are dropped and said. Scripts and animation
do not run.
"""

from __future__ import annotations

import functools
import gzip
import warnings
import zlib
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import resvg_py
from numpy.typing import NDArray

from fexel.errors import FexelError, FexelWarning

__all__ = ["is_vector_image", "rasterize"]

_SUFFIXES = (".svg", ".svgz")
_MOST_BYTES = 64 << 20  # of markup: bounds what a compressed file can unpack to
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_CSS_PIXELS_PER_INCH = 96
_DEEPEST = 128  # nested elements: resvg recurses, and a thread's stack may be small
_PROBE = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 32">'
    '<text y="28" font-size="28" font-family="{}">Mg</text></svg>'
)
_SANS = ("Arial", "Helvetica", "Liberation Sans", "DejaVu Sans", "Noto Sans", "Open Sans", "Roboto", "FreeSans")
_FAMILIES = {  # of fonts that systems come with, the first that is there stands for the generic family
    "sans_serif_family": _SANS,
    "serif_family": ("Times New Roman", "Liberation Serif", "DejaVu Serif", "Noto Serif", "FreeSerif", *_SANS),
    "monospace_family": ("Courier New", "Liberation Mono", "DejaVu Sans Mono", "Noto Sans Mono", "FreeMono", *_SANS),
}


def is_vector_image(path: str | Path) -> bool:
    """Whether a file is a drawing, by its name."""
    return Path(path).suffix.lower() in _SUFFIXES


def rasterize(path: str | Path, longer_side_px: int) -> NDArray[np.uint8]:
    """Draw an SVG on a transparent ground.

    Parameters
    ----------
    path : str or Path
        ``.svg``, or ``.svgz`` (gzip).
    longer_side_px : int
        Pixels; the other side follows from the drawing's aspect and has at least one pixel.

    Returns
    -------
    (H, W, 4) uint8
        sRGB-encoded, straight alpha, anti-aliased; row 0 at the top. Colour is 0 where alpha is 0. An empty drawing is
        transparent throughout.

    Raises
    ------
    FexelError
        Missing file, not XML, not an SVG, or a drawing without extent.

    Warns
    -----
    FexelWarning
        References outside the file were dropped; text that no font of this machine can draw.
    """
    root = _parse(path)
    dropped = _drop_external_references(root)
    if dropped:
        more = f" and {len(dropped) - 1} more" if len(dropped) > 1 else ""
        _warn(f"{path}: '{dropped[0]}'{more} is outside the file and is not drawn; embed it as data:")
    families: dict[str, str] = {}
    if any(_local_name(element) == "text" for element in root.iter()):
        families = _installed_families()
        if not families:
            _warn(f"{path}: has text and no font for it was found; it is left out: convert the text to paths")
    return _draw(path, root, longer_side_px, families)


def _parse(path: str | Path) -> ElementTree.Element:
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError:
        raise FexelError(f"{path}: no such file") from None
    except OSError as error:
        raise FexelError(f"{path}: cannot be read: {error.strerror}") from None
    try:
        root = ElementTree.fromstring(_unpacked(path, data))
    except ElementTree.ParseError as error:
        raise FexelError(f"{path}: not well-formed XML: {error}") from None
    except (LookupError, ValueError) as error:  # an encoding that Python does not know, or that the bytes are not in
        raise FexelError(f"{path}: not well-formed XML: {error}") from None
    if _local_name(root) != "svg":
        raise FexelError(f"{path}: the root element is '{_local_name(root)}', expected 'svg'")
    _check_depth(path, root)
    return root


def _check_depth(path: str | Path, root: ElementTree.Element) -> None:
    level = [root]
    for _ in range(_DEEPEST):
        level = [child for element in level for child in element]
        if not level:
            return
    raise FexelError(f"{path}: elements nested too deeply, expected at most {_DEEPEST} levels")


def _unpacked(path: str | Path, data: bytes) -> bytes:
    if data[:2] == b"\x1f\x8b":
        try:
            with gzip.open(Path(path)) as stream:
                data = stream.read(_MOST_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise FexelError(f"{path}: damaged gzip data: {error}") from None
    if len(data) > _MOST_BYTES:
        raise FexelError(f"{path}: more than {_MOST_BYTES >> 20} MiB of markup, expected at most that")
    return data


def _local_name(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _drop_external_references(root: ElementTree.Element) -> list[str]:
    """Remove every href that is neither within the document nor embedded; returns them."""
    dropped = []
    for element in root.iter():
        if _local_name(element) == "a":  # a link is drawn without being followed
            continue
        for name in _HREFS:
            target = element.get(name, "#").strip()
            if not target.startswith(("#", "data:")):
                dropped.append(target)
                del element.attrib[name]
    return dropped


@functools.cache
def _installed_families() -> dict[str, str]:
    """Fonts of this machine for the generic families, and for families that it does not have; empty without any."""
    found = {}
    for generic, candidates in _FAMILIES.items():
        family = next((family for family in candidates if _leaves_a_mark(family)), None)
        if family is not None:
            found[generic] = family
    return found and {"font_family": found["serif_family"], **found}


def _leaves_a_mark(family: str) -> bool:
    probe = resvg_py.svg_to_bytes(svg_string=_PROBE.format(family), width=64, dpi=_CSS_PIXELS_PER_INCH)
    return bool(_decode(probe)[..., 3].any())


def _draw(
    path: str | Path, root: ElementTree.Element, longer_side_px: int, families: dict[str, str]
) -> NDArray[np.uint8]:
    try:
        png = resvg_py.svg_to_bytes(
            svg_string=ElementTree.tostring(root, encoding="unicode"),
            width=longer_side_px,  # the drawing is fitted into a square of this size, its aspect kept
            height=longer_side_px,
            dpi=_CSS_PIXELS_PER_INCH,  # without it lengths in pt or mm have no size
            skip_system_fonts=not families,
            **families,
        )
    except ValueError as error:
        raise FexelError(f"{path}: cannot be drawn: {' '.join(str(error).split())}") from None
    return _decode(png)


def _decode(png: bytes) -> NDArray[np.uint8]:
    """resvg-py's own 8-bit RGBA PNG, in memory, as RGBA."""
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGBA)


def _warn(message: str) -> None:
    warnings.warn(message, FexelWarning, stacklevel=3)
