"""An image as a texture prim places it: file, mask, colour space, wrap modes, scale, bias and fallback."""

from __future__ import annotations

from dataclasses import dataclass

from fexel.textures.inputs import Inputs

__all__ = [
    "BIAS_ZERO",
    "NO_FALLBACK",
    "PATCH_WRAP",
    "SCALE_ONE",
    "ImageSource",
    "fallback_of",
    "image_source",
    "wrap_of",
]

SCALE_ONE, BIAS_ZERO = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0)
NO_FALLBACK = (0.0, 0.0, 0.0, 0.0)
PATCH_WRAP = ("patch", "patch")
_WRAP_MODES = ("black", "clamp", "repeat", "mirror", "useMetadata")


@dataclass(frozen=True)
class ImageSource:
    """An image and how it is stored; equal sources are on the GPU once, however often they are placed.

    Attributes
    ----------
    file : str
        Resolved path, or '' when there is none.
    mask : str
        Resolved path of the image that replaces the alpha, or ''.
    color_space : str
        ``auto``, ``raw`` or ``sRGB``.
    wrap : (str, str)
        UsdUVTexture's tokens along s and t for a root; ``("patch", "patch")`` for what is transparent outside [0, 1].
    scale, bias : 4-tuples
        Applied to texels; identity when all layers share theirs (`fexel.textures.zipmap.ZipmapData.scale`).
    fallback : 4-tuple
        Linear rgba, straight alpha, shown when the image cannot be read; `scale` and `bias` do not apply to it.
    """

    file: str
    mask: str = ""
    color_space: str = "auto"
    wrap: tuple[str, str] = PATCH_WRAP
    scale: tuple[float, ...] = SCALE_ONE
    bias: tuple[float, ...] = BIAS_ZERO
    fallback: tuple[float, ...] = NO_FALLBACK


def image_source(inputs: Inputs, nested: bool) -> ImageSource:
    """``inputs:file`` of a prim with all that says how it is stored.

    Parameters
    ----------
    inputs : Inputs
    nested : bool
        A patch: transparent outside of [0, 1]^2, and where it cannot be read, unless a fallback was authored.
    """
    return ImageSource(
        file=inputs.asset("file"),
        mask=inputs.asset("mask"),
        color_space=inputs.color_space(),
        wrap=PATCH_WRAP if nested else wrap_of(inputs),
        scale=inputs.vector("scale", SCALE_ONE),
        bias=inputs.vector("bias", BIAS_ZERO),
        fallback=fallback_of(inputs, nested),
    )


def wrap_of(inputs: Inputs) -> tuple[str, str]:
    """Wrap tokens along s and t; one that is not known warns and counts as ``useMetadata``."""
    return inputs.token("wrapS", _WRAP_MODES, "useMetadata"), inputs.token("wrapT", _WRAP_MODES, "useMetadata")


def fallback_of(inputs: Inputs, nested: bool) -> tuple[float, ...]:
    """Linear rgba. A patch that cannot be read leaves its parent to be seen, unless a colour was authored for that."""
    return inputs.vector("fallback", NO_FALLBACK if nested else (0.0, 0.0, 0.0, 1.0))
