"""ZipmapTexture prims, and UsdUVTexture shaders as zipmaps without patches, as flat data.

A zipmap (Eisemann and Magnor 2010, section 3) is a root image and patches, each placed by a homography relative to its
parent; the picture is ``C = sum_i w_i C_i, w_i = alpha_i prod_{j>i} (1 - alpha_j)`` (eq. 1) in draw order: depth first,
parents before children, siblings in namespace order. Here the tree is flattened and matrices are composed in float64.
A patch may be a texture of another kind; its data are its own kind's. No file is touched: an image is opened only when
a frame sees it.

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
from pxr import Usd

from fexel import homography
from fexel.errors import FexelWarning
from fexel.textures import extract_texture, texture_kind
from fexel.textures.image_source import BIAS_ZERO, SCALE_ONE, ImageSource, image_source, own_minification
from fexel.textures.inputs import Inputs, warn

__all__ = ["PRIM_TYPES", "ImageSource", "Nested", "ZipmapData", "extract"]

PRIM_TYPES = ("ZipmapTexture", "UsdUVTexture")

_KIND, _HOLDS_PATCHES = "zipmap", "ZipmapTexture"
_IDENTITY = (SCALE_ONE, BIAS_ZERO)
_LARGEST_FALLBACK = 1024.0


@dataclass(frozen=True)
class Nested:
    """A layer that is a texture of another kind.

    Attributes
    ----------
    layer : int
    kind : str
    data : object
        As `fexel.textures.extract_texture` gives it.
    """

    layer: int
    kind: str
    data: Any


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
        Image of each layer; of one of another kind, its ``inputs:file`` as a plain image, for users that know no other.
    root_to_patch : (N, 3, 3) float64
        From the texture's ``inputs:st`` to each layer's own, row vectors; w = 1 at the centre of a patch.
    opacity : (N,) float64
        In [0, 1]; 1 for the root.
    scale, bias : 4-tuples
        Of the blended result.
    nested : tuple of Nested
        Layers that are textures of other kinds.
    filters : tuple of str or None
        Minification filter of each layer: its own, else that of the texture it is nested in; empty where none is
        authored. Textures of other kinds have theirs in their own data.
    """

    paths: tuple[str, ...]
    sources: tuple[ImageSource, ...]
    source_index: NDArray[np.int32]
    root_to_patch: NDArray[np.float64]
    opacity: NDArray[np.float64]
    scale: tuple[float, ...] = SCALE_ONE
    bias: tuple[float, ...] = BIAS_ZERO
    nested: tuple[Nested, ...] = ()
    filters: tuple[str | None, ...] = ()

    @cached_property
    def _digest(self) -> bytes:
        digest = hashlib.blake2b(repr((self.paths, self.sources, self.scale, self.bias, self.filters)).encode())
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
        return isinstance(other, ZipmapData) and self._digest == other._digest and self.nested == other.nested

    def __hash__(self) -> int:
        return hash((self._digest, self.nested))


@dataclass(frozen=True)
class _Layer:
    prim: Usd.Prim
    parent: int
    depth: int
    matrix: NDArray[np.float64]
    opacity: float
    source: ImageSource
    other: tuple[str, Any] | None
    filter: str | None


def extract(prim: Usd.Prim, time: Usd.TimeCode, nested: bool = False) -> ZipmapData:
    """Read a ZipmapTexture with all that is nested in it, or a UsdUVTexture shader, at one time.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    nested : bool
        As a patch of another texture: transparent outside of [0, 1]^2.

    Warns
    -----
    FexelWarning
        Per prim: unusable matrix, unknown token, value that is not finite.
    """
    layers = list(_layers(prim, time, nested))
    matrices, usable = _compose(layers)
    layers = [layer for layer, shown in zip(layers, usable, strict=True) if shown]
    nests = tuple(Nested(number, *layer.other) for number, layer in enumerate(layers) if layer.other is not None)
    shared = _shared_scale([layer.source for layer in layers], bool(nests))
    numbers: dict[ImageSource, int] = {}
    index = []
    for layer in layers:
        source = layer.source
        if shared and shared != _IDENTITY:
            source = replace(source, scale=SCALE_ONE, bias=BIAS_ZERO, fallback=_unscaled(source))
        index.append(numbers.setdefault(source, len(numbers)))
    return ZipmapData(
        paths=tuple(str(layer.prim.GetPath()) for layer in layers),
        sources=tuple(numbers),
        source_index=np.array(index, np.int32),
        root_to_patch=matrices[usable],
        opacity=np.array([layer.opacity for layer in layers]),
        scale=shared[0] if shared else SCALE_ONE,
        bias=shared[1] if shared else BIAS_ZERO,
        nested=nests,
        filters=tuple(layer.filter for layer in layers) if any(layer.filter for layer in layers) else (),
    )


def _shared_scale(
    sources: list[ImageSource], has_other_kinds: bool
) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Scale and bias that can be applied to the blended result and yet leave every fallback as authored.

    They must be the same everywhere and have an inverse that half floats hold: beyond a bias of 2 the fallback would
    lose 8-bit steps. A scaled alpha does not commute with blending, nor can alpha 0 be scaled back. Textures of other
    kinds apply theirs themselves.
    """
    scale, bias = sources[0].scale, sources[0].bias
    if any((source.scale, source.bias) != (scale, bias) for source in sources):
        return None
    if (scale, bias) == _IDENTITY:
        return _IDENTITY
    if has_other_kinds or not all(scale) or max(map(abs, bias)) > 2.0:
        return None
    fallbacks = [_unscaled(source) for source in sources]
    if (scale[3], bias[3]) != (1.0, 0.0) and (len(sources) > 1 or fallbacks[0][3] <= 0.0):
        return None
    largest = max(abs(value) for fallback in fallbacks for value in fallback)
    return (scale, bias) if largest <= _LARGEST_FALLBACK else None


def _unscaled(source: ImageSource) -> tuple[float, ...]:
    """The fallback before scale and bias, neither of which applies to it."""
    return tuple((v - b) / s for v, s, b in zip(source.fallback, source.scale, source.bias, strict=True))


def _layers(root: Usd.Prim, time: Usd.TimeCode, nested: bool) -> Iterator[_Layer]:
    """Depth first, parents first; a stack of its own, so that no nesting depth exhausts Python's."""
    types = _TextureTypes()
    stack: list[tuple[Usd.Prim, int, int, str | None]] = [(root, -1, 0, None)]
    number = 0
    while stack:
        prim, parent, depth, enclosing = stack.pop()
        inputs = Inputs(prim, time)
        matrix, opacity = inputs.matrix(), inputs.opacity() if depth else 1.0
        other = _other(prim, time, types, enclosing) if depth else None
        if other is None:
            own = own_minification(inputs, nested or depth > 0)
            chosen = own.filter or enclosing
            source = image_source(inputs, nested or depth > 0, own)
        else:  # which has read and judged its inputs itself
            chosen, source = enclosing, ImageSource(inputs.asset("file"))
        yield _Layer(prim, parent, depth, matrix, opacity, source, other, chosen)
        if prim.GetTypeName() == _HOLDS_PATCHES:
            children = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
            patches = [child for child in children if types.is_texture(child)]
            stack.extend((child, number, depth + 1, chosen) for child in reversed(patches))
        number += 1


def _other(prim: Usd.Prim, time: Usd.TimeCode, types: _TextureTypes, enclosing: str | None) -> tuple[str, Any] | None:
    """Kind and data of a patch of another kind; a texture that no kind reads is shown as a plain image.

    Where it authors no filter and has one, that of the texture it is in is its own.
    """
    kind = types.kind(prim)
    if kind == _KIND:
        return None
    if kind is not None:
        name, data = extract_texture(prim, time, nested=True)
        inherits = enclosing is not None and getattr(data, "filter", "") is None
        return name, replace(data, filter=enclosing) if inherits else data
    fault = f"a {prim.GetTypeName()} in a ZipmapTexture is not drawn yet; inputs:file is shown as a plain image"
    warnings.warn(f"{prim.GetPath()}: {fault}", FexelWarning, stacklevel=2)
    return None


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
            warn(
                layers[number].prim,
                "inputs:matrix",
                "is singular, not finite, or maps infinity into the texture; not shown",
            )
        shown[at] = usable & shown[parents[at]] if depth else True
        matrices[at[~usable]] = np.eye(3)
        matrices[at] = homography.normalize(matrices[at])
    return matrices, shown


class _TextureTypes:
    """Whether a prim is a FexelTexture, and of which kind; asks once per type name."""

    def __init__(self) -> None:
        self._base = Usd.SchemaRegistry().GetTypeFromSchemaTypeName("FexelTexture")
        self._known: dict[str, bool] = {}
        self._kinds: dict[str, str | None] = {}

    def is_texture(self, prim: Usd.Prim) -> bool:
        name = prim.GetTypeName()
        if name not in self._known:
            self._known[name] = bool(self._base) and prim.IsA(self._base)
        return self._known[name]

    def kind(self, prim: Usd.Prim) -> str | None:
        name = prim.GetTypeName()
        if name not in self._kinds:
            self._kinds[name] = texture_kind(prim)
        return self._kinds[name]
