"""What the scripts of the photographed stages share: reduce the photos, then run what `fexel zipmap` runs."""

from __future__ import annotations

import tempfile
from pathlib import Path

import OpenImageIO as oiio

import fexel
from fexel_tools.authoring import ZipmapOptions
from fexel_tools.zipmap import make_zipmap

__all__ = ["author"]

_FALLBACK_PX = 640


def author(photos: list[Path], stage: Path, shrink: float) -> None:
    """Author `stage` from photos reduced to `shrink` times their size, the files keeping their names."""
    with tempfile.TemporaryDirectory() as folder:
        reduced = [_reduce(photo, Path(folder) / f"{photo.stem}.png", shrink) for photo in photos]
        report = make_zipmap([str(path) for path in reduced], stage, ZipmapOptions(fallback_size=_FALLBACK_PX))
    rejected = [photo.file for photo in report.photos if photo.status == "rejected"]
    if rejected:
        raise fexel.FexelError(f"{stage}: rejected {', '.join(rejected)}")


def _reduce(photo: Path, target: Path, shrink: float) -> Path:
    """Resample in linear light to a PNG."""
    source = oiio.ImageBuf(str(photo))
    spec = source.spec()
    linear = oiio.ImageBufAlgo.colorconvert(source, "srgb_rec709_scene", "lin_rec709_scene")
    size = oiio.ROI(0, round(spec.width * shrink), 0, round(spec.height * shrink), 0, 1, 0, spec.nchannels)
    small = oiio.ImageBufAlgo.resize(linear, filtername="lanczos3", roi=size)
    encoded = oiio.ImageBufAlgo.colorconvert(small, "lin_rec709_scene", "srgb_rec709_scene")
    encoded.set_write_format(oiio.UINT8)
    if encoded.has_error or not encoded.write(str(target)):
        raise fexel.FexelError(f"{photo}: {encoded.geterror()}")
    return target
