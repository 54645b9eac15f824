"""Texels of pinchmaps, checked and in the format of their pages.

A pinchmap is always whole in memory: it is small, and whether it can be used at all depends on every texel. Where it
cannot, one warning says why, and the caller shows ``inputs:fallback``.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import images
from fexel.errors import FexelError, FexelWarning
from fexel.textures.atlas import Box
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.page_format import FLOAT, SNORM
from fexel.textures.pinchmap_encoding import decode_texels, signal_half_texel
from fexel.textures.pyramid_cache import ImageFacts

__all__ = ["CONSTANT", "LARGEST_PINCHMAP", "PinchmapSource", "PinchmapTexels"]

_CHANNELS = 4
LARGEST_PINCHMAP = 8192  # texels a side: beyond it a pinchmap would fill the texture memory of any view
# Inactive everywhere: no texel of the signal is displaced.
_INACTIVE = np.array([[[0, 0, 127, 0]]], np.int8)


@dataclass(frozen=True)
class PinchmapSource:
    """A pinchmap in a page.

    Attributes
    ----------
    file : str
        Resolved path; '' for the pinchmap of one texel that displaces nothing.
    wrap : (str, str)
        How it continues along s and t: ``repeat`` with its other end, ``mirror`` with itself reversed, which is with
        its edge as far as one cell reads beyond it, ``clamp`` with its edge.
    """

    file: str = ""
    wrap: tuple[str, str] = ("clamp", "clamp")


CONSTANT = PinchmapSource()


@dataclass(frozen=True)
class _Facts:
    size: tuple[int, int]
    page_class: int


class PinchmapTexels:
    """Reads pinchmaps. Warns once about each that cannot be used.

    Parameters
    ----------
    kept : KeptTexels, optional
        Where texels are kept; by default its own.
    """

    def __init__(self, kept: KeptTexels | None = None) -> None:
        self._kept = kept or KeptTexels()
        self._facts: dict[str, _Facts | FexelError] = {"": _Facts((1, 1), SNORM)}
        self._warned: set[str] = set()

    def source(
        self, file: str, path: str, signal: images.ImageInfo | None, wrap: tuple[str, str]
    ) -> PinchmapSource | None:
        """The pinchmap for a signal, or None where it cannot be used.

        Parameters
        ----------
        file : str
            Resolved path, '' for none.
        path : str
            Prim to name.
        signal : ImageInfo or None
            None where the signal is a constant.
        wrap : (str, str)
            Resolved wrap modes of the signal; all but ``repeat`` and ``mirror`` clamp.
        """
        if not file or signal is None:
            return CONSTANT
        try:
            width, height = self._checked(file).size
            if signal_half_texel((width, height), (signal.width, signal.height)) is None:
                raise FexelError(
                    f"{file}: {width} x {height} texels for a signal of {signal.width} x {signal.height}, expected the "
                    "signal's size divided by the same power of two along both axes"
                )
        except FexelError as error:
            self._warn(path, str(error))
            return None
        s, t = (mode if mode in ("repeat", "mirror") else "clamp" for mode in wrap)
        return PinchmapSource(file, (s, t))

    def _warn(self, path: str, fault: str, instead: str = "inputs:fallback is shown") -> None:
        message = f"{path}.inputs:pinchmap: {fault}; {instead}"
        if message not in self._warned:
            self._warned.add(message)
            warnings.warn(message, FexelWarning, stacklevel=2)

    def _checked(self, file: str) -> _Facts:
        """Facts of a pinchmap that can be used; every texel has been looked at."""
        if file not in self._facts:
            try:
                texels = _stored(file)
                self._kept.keep(("pinchmap", file), texels, texels.nbytes)
                self._facts[file] = _facts(texels)
            except FexelError as error:
                self._facts[file] = error
        facts = self._facts[file]
        if isinstance(facts, FexelError):
            raise facts
        return facts

    def _read(self, source: PinchmapSource, path: str) -> NDArray:
        """(H, W, 4) int8, of which 127 is 1, or float32; inactive where a file is not any more what it was."""
        if not source.file:
            return _INACTIVE
        facts = self._checked(source.file)
        texels = self._kept.get(("pinchmap", source.file))
        if texels is None:
            try:
                texels = _stored(source.file)
                if _facts(texels) != facts:
                    raise FexelError(f"{source.file}: has changed since it was first read")
            except FexelError as error:
                self._warn(path, str(error), "the plain image is shown")
                texels = np.broadcast_to(_INACTIVE / np.float32(127), (facts.size[1], facts.size[0], 4))
                texels = texels if facts.page_class == FLOAT else (texels * 127).astype(np.int8)
            self._kept.keep(("pinchmap", source.file), texels, texels.nbytes)
        return texels

    def texels(self, source: PinchmapSource, path: str) -> NDArray[np.float64]:
        """(H, W, 4), d_s, d_t, k, gamma in [-1, 1]."""
        texels = self._read(source, path)
        return texels / 127.0 if texels.dtype == np.int8 else texels.astype(np.float64)

    def facts(self, source: PinchmapSource, _path: str) -> ImageFacts:
        """See `fexel.textures.pool.TexelReader`."""
        facts = self._checked(source.file)
        return ImageFacts(facts.size, facts.page_class, source.wrap, None, has_levels=False)

    def window(self, source: PinchmapSource, path: str, _level: int, box: Box) -> NDArray:
        """See `fexel.textures.pool.TexelReader`; there is level 0 alone."""
        texels = self._read(source, path)
        column = _continued(np.arange(box[0] - 1, box[2] + 1), texels.shape[1], source.wrap[0])
        row = _continued(np.arange(box[1] - 1, box[3] + 1), texels.shape[0], source.wrap[1])
        return np.ascontiguousarray(texels[row[:, None], column])


def _continued(index: NDArray[np.int64], size: int, mode: str) -> NDArray[np.int64]:
    return index % size if mode == "repeat" else index.clip(0, size - 1)


def _facts(texels: NDArray) -> _Facts:
    return _Facts((texels.shape[1], texels.shape[0]), SNORM if texels.dtype == np.int8 else FLOAT)


def _stored(file: str) -> NDArray:
    info = images.image_info(file)
    if info.channels != _CHANNELS:
        raise FexelError(f"{file}: {info.channels} channels, expected 4 (d_s, d_t, k, gamma)")
    if max(info.width, info.height) > LARGEST_PINCHMAP:
        raise FexelError(
            f"{file}: {info.width} x {info.height} texels, expected at most {LARGEST_PINCHMAP} along an axis"
        )
    texels = images.read_pixels(info)
    if texels.dtype == np.uint8:
        return (texels.astype(np.int16) - 127).clip(-127, 127).astype(np.int8)
    if texels.dtype.kind == "f" and not np.isfinite(texels).all():
        row, column, _ = np.argwhere(~np.isfinite(texels))[0]
        raise FexelError(
            f"{file}: a value that is not finite at column {column}, row {row}, expected values in [-1, 1]"
        )
    return decode_texels(texels).astype(np.float32)
