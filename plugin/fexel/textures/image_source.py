"""An image as a texture prim places it: file, mask, colour space, wrap modes, scale, bias and fallback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from fexel.filters.minification import NO_MINIFICATION, Minification, filter_of, minification_of
from fexel.textures.inputs import Inputs, warn

if TYPE_CHECKING:
    from fexel.images import ImageInfo

__all__ = [
    "BIAS_ZERO",
    "NO_FALLBACK",
    "PATCH_WRAP",
    "SCALE_ONE",
    "ImageSource",
    "decodes_vectors",
    "fallback_of",
    "holds_vectors",
    "image_source",
    "own_minification",
    "toned",
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
    soft_rim : bool
        Of a patch: coarser levels are those of level 0 with its rim cleared. Else each level has a cleared rim of its
        own, as an ordinary lookup needs it to end at the border; then patches are the smaller the coarser they are.
    """

    file: str
    mask: str = ""
    color_space: str = "auto"
    wrap: tuple[str, str] = PATCH_WRAP
    scale: tuple[float, ...] = SCALE_ONE
    bias: tuple[float, ...] = BIAS_ZERO
    fallback: tuple[float, ...] = NO_FALLBACK
    soft_rim: bool = False

    def resolved_space(self, info: ImageInfo) -> str:
        """``raw`` or ``sRGB``: what is asked for, else what the format of the file says."""
        return info.color_space if self.color_space == "auto" else self.color_space


def image_source(inputs: Inputs, nested: bool, own: Minification = NO_MINIFICATION) -> ImageSource:
    """``inputs:file`` of a prim with all that says how it is stored.

    Parameters
    ----------
    inputs : Inputs
    nested : bool
        A patch: transparent outside of [0, 1]^2, and where it cannot be read, unless a fallback was authored.
    own : Minification
        Whose contrast and brightness are those of the image: of a patch.
    """
    scale, bias = toned(inputs.vector("scale", SCALE_ONE), inputs.vector("bias", BIAS_ZERO), own)
    return ImageSource(
        file=inputs.asset("file"),
        mask=inputs.asset("mask"),
        color_space=inputs.color_space(),
        wrap=PATCH_WRAP if nested else wrap_of(inputs),
        scale=scale,
        bias=bias,
        fallback=fallback_of(inputs, nested, own),
    )


def own_minification(inputs: Inputs, nested: bool) -> Minification:
    """What a prim says of its minification as far as its kind's data are to know it.

    The token, which may be None, of any texture. Contrast and brightness of a patch alone: they commute with every
    filter, so they are of its image; those of a root hold for what a material reads. Attenuation is not for patches.
    """
    if not nested:
        return Minification(filter=filter_of(inputs))
    own = minification_of(inputs)
    if own.attenuates:
        fault = "is ignored on a patch; attenuation is that of the texture which a material reads"
        warn(inputs.prim, "minification:attenuationDistance", fault)
    return own


def toned(
    scale: tuple[float, ...], bias: tuple[float, ...], own: Minification
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Scale and bias with contrast s and brightness o after them: s (scale c + bias) + o, alpha untouched."""
    s, o = own.contrast, own.brightness
    return (*(s * v for v in scale[:3]), scale[3]), (*(s * v + o for v in bias[:3]), bias[3])


def decodes_vectors(scale: tuple[float, ...], bias: tuple[float, ...]) -> bool:
    """Whether colours in [0, 1] become vectors in [-1, 1]; x and y may run backward, alpha may be anything."""
    around_zero = all(bias[axis] == -0.5 * scale[axis] for axis in range(3))
    return around_zero and abs(scale[0]) == abs(scale[1]) == scale[2] == 2.0


def holds_vectors(
    source: ImageSource, info: ImageInfo | None, scale: tuple[float, ...], bias: tuple[float, ...]
) -> bool:
    """Whether `scale` and `bias`, or those of the image itself, decode vectors from data, not from encoded colours.

    `info` is that of the file, None where a fallback stands in: which nothing decodes.
    """
    decodes = decodes_vectors(scale, bias) or decodes_vectors(source.scale, source.bias)
    return decodes and info is not None and source.resolved_space(info) == "raw"


def wrap_of(inputs: Inputs) -> tuple[str, str]:
    """Wrap tokens along s and t; one that is not known warns and counts as ``useMetadata``."""
    return inputs.token("wrapS", _WRAP_MODES, "useMetadata"), inputs.token("wrapT", _WRAP_MODES, "useMetadata")


def fallback_of(inputs: Inputs, nested: bool, own: Minification = NO_MINIFICATION) -> tuple[float, ...]:
    """Linear rgba, with contrast and brightness of `own` as an image would have them.

    A patch that cannot be read leaves its parent to be seen, unless a colour was authored for that.
    """
    fallback = inputs.vector("fallback", NO_FALLBACK if nested else (0.0, 0.0, 0.0, 1.0))
    return (*(own.contrast * v + own.brightness for v in fallback[:3]), fallback[3]) if fallback[3] else fallback
