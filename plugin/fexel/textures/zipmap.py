"""ZipmapTexture prims, and UsdUVTexture shaders as zipmaps without patches, as flat data.

A zipmap (Eisemann and Magnor 2010, section 3) is a root image and patches, each placed by a homography relative to its
parent; the picture is ``C = sum_i w_i C_i, w_i = alpha_i prod_{j>i} (1 - alpha_j)`` (eq. 1) in draw order: depth first,
parents before children, siblings in namespace order. Here the tree is flattened and matrices are composed in float64.
No file is touched: an image is opened only when a frame sees it.

Layer 0 is the root. A layer whose matrix is singular or not finite warns once, naming the prim, and is left out; so are
the layers below it.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from fexel import homography
from fexel.errors import FexelWarning

__all__ = ["PRIM_TYPES", "ImageSource", "ZipmapData", "extract"]

PRIM_TYPES = ("ZipmapTexture", "UsdUVTexture")

_FILTER = "minification:filter"
_UNDRAWN_KINDS = {"PinchmapTexture": "contours", "UmbrellaTexture": "umbrellas"}
_SRGB_NAMES = {"srgb", "srgb_texture", "srgb_rec709_scene", "srgb_rec709_display", "srgb - texture"}
_SCALE_ONE, _BIAS_ZERO = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0)
_IDENTITY = (_SCALE_ONE, _BIAS_ZERO)
_LARGEST_FALLBACK = 1024.0
_NO_FALLBACK = (0.0, 0.0, 0.0, 0.0)
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
        Applied to texels; identity when all layers share theirs (`ZipmapData.scale`).
    fallback : 4-tuple
        Linear rgba, straight alpha, shown when the image cannot be read; `scale` and `bias` do not apply to it.
    """

    file: str
    mask: str = ""
    color_space: str = "auto"
    wrap: tuple[str, str] = ("patch", "patch")
    scale: tuple[float, ...] = _SCALE_ONE
    bias: tuple[float, ...] = _BIAS_ZERO
    fallback: tuple[float, ...] = _NO_FALLBACK


@dataclass(frozen=True, eq=False)
class ZipmapData:
    """A zipmap at one time. Equal content compares and hashes equal.

    Attributes
    ----------
    paths : tuple of str
        Prim path of each layer in draw order, the root first.
    sources : tuple of ImageSource
        Distinct images.
    source_index : (N,) int32
        Image of each layer.
    root_to_patch : (N, 3, 3) float64
        From the texture's ``inputs:st`` to each layer's own, row vectors; w = 1 at the centre of a patch.
    opacity : (N,) float64
        In [0, 1]; 1 for the root.
    scale, bias : 4-tuples
        Of the blended result.
    """

    paths: tuple[str, ...]
    sources: tuple[ImageSource, ...]
    source_index: NDArray[np.int32]
    root_to_patch: NDArray[np.float64]
    opacity: NDArray[np.float64]
    scale: tuple[float, ...] = _SCALE_ONE
    bias: tuple[float, ...] = _BIAS_ZERO

    @cached_property
    def _digest(self) -> bytes:
        digest = hashlib.blake2b(repr((self.paths, self.sources, self.scale, self.bias)).encode())
        for array in (self.source_index, self.root_to_patch, self.opacity):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.digest()

    @cached_property
    def bounds(self) -> NDArray[np.float64]:
        """(N, 4) s_min, t_min, s_max, t_max of each layer in ``inputs:st``; the root's unbounded."""
        bounds = homography.unit_square_bounds(self.root_to_patch)
        bounds[0] = -np.inf, -np.inf, np.inf, np.inf
        return bounds

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ZipmapData) and self._digest == other._digest

    def __hash__(self) -> int:
        return hash(self._digest)


@dataclass(frozen=True)
class _Layer:
    prim: Usd.Prim
    parent: int
    depth: int
    matrix: NDArray[np.float64]
    opacity: float
    source: ImageSource


def extract(prim: Usd.Prim, time: Usd.TimeCode) -> ZipmapData:
    """Read a ZipmapTexture with all that is nested in it, or a UsdUVTexture shader, at one time.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode

    Warns
    -----
    FexelWarning
        Per prim: unusable matrix, unknown token, value that is not finite.
    """
    layers = list(_layers(prim, time))
    matrices, usable = _compose(layers)
    layers = [layer for layer, shown in zip(layers, usable, strict=True) if shown]
    shared = _shared_scale([layer.source for layer in layers])
    numbers: dict[ImageSource, int] = {}
    index = []
    for layer in layers:
        source = layer.source
        if shared and shared != _IDENTITY:
            source = replace(source, scale=_SCALE_ONE, bias=_BIAS_ZERO, fallback=_unscaled(source))
        index.append(numbers.setdefault(source, len(numbers)))
    return ZipmapData(
        paths=tuple(str(layer.prim.GetPath()) for layer in layers),
        sources=tuple(numbers),
        source_index=np.array(index, np.int32),
        root_to_patch=matrices[usable],
        opacity=np.array([layer.opacity for layer in layers]),
        scale=shared[0] if shared else _SCALE_ONE,
        bias=shared[1] if shared else _BIAS_ZERO,
    )


def _shared_scale(sources: list[ImageSource]) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Scale and bias that can be applied to the blended result and yet leave every fallback as authored.

    They must be the same everywhere and have an inverse that half floats hold: beyond a bias of 2 the fallback would
    lose 8-bit steps. A scaled alpha does not commute with blending, nor can alpha 0 be scaled back.
    """
    scale, bias = sources[0].scale, sources[0].bias
    if any((source.scale, source.bias) != (scale, bias) for source in sources):
        return None
    if (scale, bias) == _IDENTITY:
        return _IDENTITY
    if not all(scale) or max(map(abs, bias)) > 2.0:
        return None
    fallbacks = [_unscaled(source) for source in sources]
    if (scale[3], bias[3]) != (1.0, 0.0) and (len(sources) > 1 or fallbacks[0][3] <= 0.0):
        return None
    largest = max(abs(value) for fallback in fallbacks for value in fallback)
    return (scale, bias) if largest <= _LARGEST_FALLBACK else None


def _unscaled(source: ImageSource) -> tuple[float, ...]:
    """The fallback before scale and bias, neither of which applies to it."""
    return tuple((v - b) / s for v, s, b in zip(source.fallback, source.scale, source.bias, strict=True))


def _layers(root: Usd.Prim, time: Usd.TimeCode) -> Iterator[_Layer]:
    """Depth first, parents first; a stack of its own, so that no nesting depth exhausts Python's."""
    is_texture = _TextureTypes()
    stack = [(root, -1, 0)]
    number = 0
    while stack:
        prim, parent, depth = stack.pop()
        inputs = _Inputs(prim, time)
        _warn_of_undrawn(inputs)
        yield _Layer(
            prim, parent, depth, inputs.matrix(), inputs.opacity() if depth else 1.0, _source(inputs, depth == 0)
        )
        if is_texture.holds_patches(prim):
            children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
            stack.extend((child, number, depth + 1) for child in reversed(list(children)) if is_texture(child))
        number += 1


def _warn_of_undrawn(inputs: _Inputs) -> None:
    """What a prim asks for beyond an image: other kinds nested in a zipmap, other filters."""
    prim = inputs.prim
    undrawn = _UNDRAWN_KINDS.get(str(prim.GetTypeName()))
    if undrawn:
        fault = f"the {undrawn} of a {prim.GetTypeName()} in a ZipmapTexture are not drawn yet"
        warnings.warn(f"{prim.GetPath()}: {fault}; inputs:file is shown as a plain image", FexelWarning, stacklevel=2)
    if inputs.names_filter:
        chosen = prim.GetAttribute(_FILTER).Get()
        if chosen not in (None, "anisotropic"):
            _warn(prim, _FILTER, f"{chosen!r} is not drawn yet; anisotropic is shown")


def _compose(layers: list[_Layer]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Root-to-patch matrices, one nesting depth at a time, and which layers are shown."""
    matrices = np.array([layer.matrix for layer in layers])
    parents = np.array([layer.parent for layer in layers])
    depths = np.array([layer.depth for layer in layers])
    shown = np.ones(len(layers), bool)
    for depth in range(depths.max() + 1):
        at = np.flatnonzero(depths == depth)
        if depth:
            with np.errstate(all="ignore"):  # NaN and Inf as authored are found just below
                matrices[at] = matrices[parents[at]] @ matrices[at]
        usable = homography.is_usable(matrices[at])
        for number in at[~usable & (shown[parents[at]] if depth else True)]:
            _warn(
                layers[number].prim,
                "inputs:matrix",
                "is singular, not finite, or maps infinity into the texture; not shown",
            )
        shown[at] = usable & shown[parents[at]] if depth else True
        matrices[at[~usable]] = np.eye(3)
        matrices[at] = homography.normalize(matrices[at])
    return matrices, shown


class _TextureTypes:
    """Whether a prim is a FexelTexture; asks the schema once per type name."""

    def __init__(self) -> None:
        self._base = Usd.SchemaRegistry().GetTypeFromSchemaTypeName("FexelTexture")
        self._known: dict[str, bool] = {}

    def __call__(self, prim: Usd.Prim) -> bool:
        name = prim.GetTypeName()
        if name not in self._known:
            self._known[name] = bool(self._base) and prim.IsA(self._base)
        return self._known[name]

    def holds_patches(self, prim: Usd.Prim) -> bool:
        return prim.GetTypeName() == "ZipmapTexture"


class _Inputs:
    """The authored inputs of one texture prim, each read once; what is not authored costs nothing."""

    def __init__(self, prim: Usd.Prim, time: Usd.TimeCode) -> None:
        self.prim = prim
        names = prim.GetAuthoredPropertyNames()
        self.names_filter = _FILTER in names
        self._attributes = {
            name[7:]: _producer(prim.GetAttribute(name)) for name in names if name.startswith("inputs:")
        }
        self._values = {name: attribute.Get(time) for name, attribute in self._attributes.items() if attribute}

    def value(self, name: str) -> Any:
        return self._values.get(name)

    def attribute(self, name: str) -> Usd.Attribute | None:
        """The authored attribute that produces the value of ``inputs:name``."""
        return self._attributes.get(name)

    def asset(self, name: str) -> str:
        value = self.value(name)
        if not isinstance(value, Sdf.AssetPath):
            return ""
        return value.resolvedPath or _anchored(value.path, self._attributes[name])

    def matrix(self) -> NDArray[np.float64]:
        value = self.value("matrix")
        return np.eye(3) if value is None else np.array(value, np.float64)

    def opacity(self) -> float:
        value = self.value("opacity")
        opacity = 1.0 if value is None else float(value)
        return min(max(opacity, 0.0), 1.0) if opacity == opacity else 0.0

    def vector(self, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        value = self.value(name)
        if value is None:
            return default
        values = tuple(float(v) for v in value)
        if not np.isfinite(values).all():
            _warn(self.prim, f"inputs:{name}", f"is {values}, expected finite values; {default} is used")
            return default
        return values

    def token(self, name: str, allowed: tuple[str, ...], default: str) -> str:
        value = self.value(name)
        if value is None or value in allowed:
            return default if value is None else str(value)
        _warn(
            self.prim, f"inputs:{name}", f"is {str(value)!r}, expected one of {', '.join(allowed)}; {default} is used"
        )
        return default


def _anchored(path: str, attribute: Usd.Attribute) -> str:
    """A path that USD cannot resolve, as it reads from its layer: the current directory must not step in."""
    stack = attribute.GetPropertyStack(Usd.TimeCode.Default()) if path else []
    return Sdf.ComputeAssetPathRelativeToLayer(stack[0].layer, path) if stack else path


def _producer(attribute: Usd.Attribute) -> Usd.Attribute:
    """Where the value of an attribute comes from, over connections."""
    if attribute and attribute.HasAuthoredConnections():
        sources = UsdShade.Utils.GetValueProducingAttributes(UsdShade.Input(attribute))
        return sources[0] if sources else attribute
    return attribute


def _source(inputs: _Inputs, is_root: bool) -> ImageSource:
    wrap = ("patch", "patch")
    if is_root:
        wrap = (inputs.token("wrapS", _WRAP_MODES, "useMetadata"), inputs.token("wrapT", _WRAP_MODES, "useMetadata"))
    return ImageSource(
        file=inputs.asset("file"),
        mask=inputs.asset("mask"),
        color_space=_color_space(inputs),
        wrap=wrap,
        scale=inputs.vector("scale", _SCALE_ONE),
        bias=inputs.vector("bias", _BIAS_ZERO),
        # A patch that cannot be read leaves its parent to be seen, unless a colour was authored for that case.
        fallback=inputs.vector("fallback", (0.0, 0.0, 0.0, 1.0) if is_root else _NO_FALLBACK),
    )


def _color_space(inputs: _Inputs) -> str:
    """``colorSpace`` of the file attribute, else ``inputs:sourceColorSpace``."""
    attribute = inputs.attribute("file")
    authored = attribute.GetColorSpace().lower() if attribute is not None and attribute.HasColorSpace() else "auto"
    if authored != "auto":
        return "sRGB" if authored in _SRGB_NAMES else "raw"
    return inputs.token("sourceColorSpace", ("auto", "raw", "sRGB"), "auto")


def _warn(prim: Usd.Prim, attribute: str, fault: str) -> None:
    warnings.warn(f"{prim.GetPath()}.{attribute}: {fault}", FexelWarning, stacklevel=2)
