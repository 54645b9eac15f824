"""The authored inputs of one texture prim at one time, whatever its kind.

What is not authored costs nothing; connections are followed to the attribute that produces the value; what cannot be
used warns once, naming prim and attribute, and is replaced by a default.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdShade

from fexel import homography
from fexel.errors import FexelWarning

__all__ = ["IDENTITY", "Inputs", "warn"]

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_MINIFICATION = "minification:"
_SRGB_NAMES = {"srgb", "srgb_texture", "srgb_rec709_scene", "srgb_rec709_display", "srgb - texture"}


class Inputs:
    """The authored inputs of one texture prim, each read once.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    namespace : str
        Of the attributes that are inputs; '' for prims that name theirs plainly, as those below a texture do.

    Attributes
    ----------
    minification : tuple of str
        Authored properties of TextureMinificationAPI, which `fexel.filters.minification` reads.
    """

    def __init__(self, prim: Usd.Prim, time: Usd.TimeCode, namespace: str = "inputs:") -> None:
        self.prim = prim
        self.time = time
        self._namespace = namespace
        names = prim.GetAuthoredPropertyNames()
        self.minification = tuple(name for name in names if name.startswith(_MINIFICATION))
        self._attributes = {
            name[len(namespace) :]: _producer(prim.GetAttribute(name)) for name in names if name.startswith(namespace)
        }
        self._values = {name: attribute.Get(time) for name, attribute in self._attributes.items() if attribute}

    def value(self, name: str) -> Any:
        """Of ``inputs:name``; None where nothing is authored."""
        return self._values.get(name)

    def attribute(self, name: str) -> Usd.Attribute | None:
        """The authored attribute that produces the value of ``inputs:name``."""
        return self._attributes.get(name)

    def asset(self, name: str) -> str:
        """Resolved path, or '' where no file is named; a path that does not resolve is given as its layer means it."""
        value = self.value(name)
        if not isinstance(value, Sdf.AssetPath):
            return ""
        return value.resolvedPath or _anchored(value.path, self._attributes[name])

    def matrix(self) -> NDArray[np.float64]:
        """``inputs:matrix`` as authored, (3, 3); whether it is usable is for the caller to say."""
        value = self.value("matrix")
        return np.eye(3) if value is None else np.array(value, np.float64)

    def placement(self) -> tuple[tuple[float, ...], ...]:
        """``inputs:matrix`` of a root, 3 rows of 3; the identity, with a warning, where it is not usable."""
        matrix = self.matrix()
        if not homography.is_usable(matrix[None])[0]:
            fault = "is singular, not finite, or maps infinity into the texture; it is left out"
            warn(self.prim, "inputs:matrix", fault)
            return IDENTITY
        return tuple(tuple(row) for row in matrix.tolist())

    def opacity(self) -> float:
        """``inputs:opacity`` in [0, 1]; 0 for NaN."""
        value = self.value("opacity")
        opacity = 1.0 if value is None else float(value)
        return min(max(opacity, 0.0), 1.0) if opacity == opacity else 0.0

    def number(self, name: str, default: float, lowest: float) -> float:
        """A finite number, at least `lowest`."""
        value = self.value(name)
        number = default if value is None else float(value)
        if math.isfinite(number) and number >= lowest:
            return number
        warn(
            self.prim,
            self._namespace + name,
            f"is {number:g}, expected a finite value from {lowest:g}; {default:g} is used",
        )
        return default

    def vector(self, name: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Finite values, as many as the default has."""
        value = self.value(name)
        if value is None:
            return default
        values = tuple(float(v) for v in value)
        if not np.isfinite(values).all():
            warn(self.prim, self._namespace + name, f"is {values}, expected finite values; {default} is used")
            return default
        return values

    def token(self, name: str, allowed: tuple[str, ...], default: str) -> str:
        """One of `allowed`."""
        value = self.value(name)
        if value is None or value in allowed:
            return default if value is None else str(value)
        expected = ", ".join(allowed)
        warn(self.prim, self._namespace + name, f"is {str(value)!r}, expected one of {expected}; {default} is used")
        return default

    def color_space(self, name: str = "file") -> str:
        """``auto``, ``raw`` or ``sRGB``: ``colorSpace`` of the file attribute, else ``inputs:sourceColorSpace``."""
        attribute = self.attribute(name)
        authored = attribute.GetColorSpace().lower() if attribute is not None and attribute.HasColorSpace() else "auto"
        if authored != "auto":
            return "sRGB" if authored in _SRGB_NAMES else "raw"
        return self.token("sourceColorSpace", ("auto", "raw", "sRGB"), "auto")


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


def warn(prim: Usd.Prim, attribute: str, fault: str) -> None:
    """Warn of an attribute of a prim."""
    warnings.warn(f"{prim.GetPath()}.{attribute}: {fault}", FexelWarning, stacklevel=2)
