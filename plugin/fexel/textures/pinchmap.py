"""PinchmapTexture prims as data: a signal image and the pinchmap that warps it (Tarini and Cignoni 2005).

No file is touched: images are opened only when a frame sees them. The pinchmap is raw data whatever colour space is
authored; that of the signal is as on any texture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from pxr import Usd

from fexel.textures.image_source import ImageSource, image_source, own_minification
from fexel.textures.inputs import IDENTITY, Inputs, warn

__all__ = ["PRIM_TYPES", "PinchmapData", "extract"]

PRIM_TYPES = ("PinchmapTexture",)


@dataclass(frozen=True)
class PinchmapData:
    """A pinchmap texture at one time.

    Attributes
    ----------
    signal : ImageSource
        ``inputs:file``. A patch's clamps: what is transparent outside of [0, 1]^2 is decided by its coordinates.
    pinchmap : str
        Resolved path of the channels d_s, d_t, k, gamma; '' for a plain image.
    antialias : float
        Width of the transition across a discontinuity in pixels, >= 0; 0 is a hard edge.
    line_width : float
        Width of a solid line along the discontinuities in texels of the pinchmap, >= 0; 0 is none.
    line_color : 4-tuple
        Linear rgba, straight alpha in [0, 1].
    st_to_texture : 3 tuples of 3
        ``inputs:matrix``, for row vectors, from ``inputs:st`` to the texture's own coordinates; identity for a patch.
    filter : str or None
        Minification filter of the signal; None where none is authored.
    """

    signal: ImageSource
    pinchmap: str
    antialias: float = 1.0
    line_width: float = 0.0
    line_color: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    st_to_texture: tuple[tuple[float, ...], ...] = IDENTITY
    filter: str | None = None


def extract(prim: Usd.Prim, time: Usd.TimeCode, nested: bool = False) -> PinchmapData:
    """Read a PinchmapTexture at one time.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    nested : bool
        As a patch of another texture: transparent outside of [0, 1]^2. Its matrix and opacity are for that to apply.

    Warns
    -----
    FexelWarning
        Per attribute: unknown token, value that is not finite or outside of the range it must be in.
    """
    inputs = Inputs(prim, time)
    minification = own_minification(inputs, nested)
    signal = image_source(inputs, nested, minification)
    return PinchmapData(
        signal=replace(signal, wrap=("clamp", "clamp")) if nested else signal,
        pinchmap=inputs.asset("pinchmap"),
        antialias=inputs.number("antialias", 1.0, 0.0),
        line_width=inputs.number("lineWidth", 0.0, 0.0),
        line_color=_line_color(inputs),
        st_to_texture=IDENTITY if nested else inputs.placement(),
        filter=minification.filter,
    )


def _line_color(inputs: Inputs) -> tuple[float, ...]:
    *color, alpha = inputs.vector("lineColor", (0.0, 0.0, 0.0, 1.0))
    within = min(max(alpha, 0.0), 1.0)
    if within != alpha:
        warn(inputs.prim, "inputs:lineColor", f"has alpha {alpha:g}, expected 0 to 1; {within:g} is used")
    return *color, within
