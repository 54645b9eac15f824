"""What a prim with TextureMinificationAPI asks for: a filter, contrast and brightness, attenuation with distance.

Contrast s and brightness o make ``s c + o`` of a filtered colour c (Bornik and Ferko 2002, eq. 1); both commute with
every filter whose weights sum to one, so that they come after it. With distance d a texture fades to a colour, as haze
does: what is left of it is ``exp(-d / attenuationDistance)``.

Attributes count only where the schema is applied. A value that cannot be used warns once, naming prim and attribute,
and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from pxr import Usd

from fexel.filters import DEFAULT_FILTER, FILTERS, PORTABLE_FILTERS
from fexel.textures.inputs import Inputs, warn

__all__ = ["NO_MINIFICATION", "Minification", "filter_of", "minification_of", "minification_of_prim", "numbers_of"]

_API = "TextureMinificationAPI"
_PREFIX = "minification:"
_WHITE = (1.0, 1.0, 1.0)

Tell = Callable[[Usd.Prim, str, str], None]


@dataclass(frozen=True)
class Minification:
    """How a texture is filtered, and what distance makes of it.

    Attributes
    ----------
    filter : str or None
        One of `fexel.filters.FILTERS`; None where a prim leaves it open.
    contrast, brightness : float
        s and o of ``s c + o``, on linear, straight colour; of data, on the values as they are used. Finite.
    attenuation_distance : float
        Scene units at which 1/e of the texture is left; > 0, inf for no attenuation.
    attenuation_color : 3-tuple
        Linear Rec.709, >= 0; what the texture fades to.
    """

    filter: str | None = None
    contrast: float = 1.0
    brightness: float = 0.0
    attenuation_distance: float = math.inf
    attenuation_color: tuple[float, float, float] = _WHITE

    @property
    def toned(self) -> bool:
        """Whether contrast or brightness change anything."""
        return (self.contrast, self.brightness) != (1.0, 0.0)

    @property
    def attenuates(self) -> bool:
        """Whether distance does."""
        return math.isfinite(self.attenuation_distance)


NO_MINIFICATION = Minification()
"""Of a prim without the schema."""


def filter_of(inputs: Inputs) -> str | None:
    """The filter that a prim authors; None where it leaves it open, `DEFAULT_FILTER`, with a warning, for others."""
    return _filter(inputs.prim, inputs.time, inputs.minification, warn)


def minification_of(inputs: Inputs) -> Minification:
    """All that a prim authors, with a warning per attribute that cannot be used; see `filter_of` for the filter."""
    return minification_of_prim(inputs.prim, inputs.time, inputs.minification, tells_filter=True)


def minification_of_prim(
    prim: Usd.Prim,
    time: Usd.TimeCode,
    names: Iterable[str] | None = None,
    *,
    tells_filter: bool = False,
    tell: Tell = warn,
) -> Minification:
    """All that a prim authors at a time.

    Parameters
    ----------
    prim : Usd.Prim
    time : Usd.TimeCode
    names : iterable of str, optional
        Its authored properties that begin with ``minification:``, where they are known.
    tells_filter : bool
        Warn of an unknown filter and of a schema that is not applied; else somebody does who reads the filter.
    tell : callable
        Warns: of a prim, an attribute's name, a fault.
    """
    if names is None:
        names = [name for name in prim.GetAuthoredPropertyNames() if name.startswith(_PREFIX)]
    names = set(names)
    if not names:
        return NO_MINIFICATION
    token = _filter(prim, time, names, tell if tells_filter else None)
    if not prim.HasAPI(_API):
        return NO_MINIFICATION
    values = _Values(prim, time, names, tell)
    return Minification(
        filter=token,
        contrast=values.number("contrast", 1.0),
        brightness=values.number("brightness", 0.0),
        attenuation_distance=values.distance("attenuationDistance"),
        attenuation_color=values.color("attenuationColor"),
    )


def numbers_of(value: Any, count: int) -> tuple[float, ...] | None:
    """A value of an attribute as so many numbers; None where it is of another type."""
    try:
        numbers = (float(value),) if count == 1 else tuple(float(v) for v in value)
    except (TypeError, ValueError):
        return None
    return numbers if len(numbers) == count and not isinstance(value, str) else None


def _filter(prim: Usd.Prim, time: Usd.TimeCode, names: Iterable[str], tell: Tell | None) -> str | None:
    if not names:
        return None
    if not prim.HasAPI(_API):
        if tell:
            tell(prim, min(names), f"is authored, but {_API} is not applied to the prim; it is left out")
        return None
    name = _PREFIX + "filter"
    token = prim.GetAttribute(name).Get(time) if name in names else None
    if token is None or token in FILTERS:
        return token
    if tell:
        expected = ", ".join(PORTABLE_FILTERS)
        tell(prim, name, f"is {str(token)!r}, expected one of {expected}; {DEFAULT_FILTER} is used")
    return DEFAULT_FILTER


@dataclass(frozen=True)
class _Values:
    """Authored values of a prim, judged."""

    prim: Usd.Prim
    time: Usd.TimeCode
    names: set[str]
    tell: Tell

    def number(self, name: str, default: float) -> float:
        """A finite number."""
        value = self._value(name, 1)
        if value is None or math.isfinite(value[0]):
            return default if value is None else value[0]
        return self._refused(name, f"{value[0]:g}, expected a finite number; {default:g} is used", default)

    def distance(self, name: str) -> float:
        """Above zero; inf where nothing is authored."""
        value = self._value(name, 1)
        if value is None or value[0] > 0.0:
            return math.inf if value is None else value[0]
        return self._refused(name, f"{value[0]:g}, expected more than 0; nothing is attenuated", math.inf)

    def color(self, name: str) -> tuple[float, float, float]:
        """Finite and >= 0; white where nothing is authored."""
        value = self._value(name, 3)
        if value is None or all(math.isfinite(v) and v >= 0.0 for v in value):
            return _WHITE if value is None else (value[0], value[1], value[2])
        shown = ", ".join(f"{v:g}" for v in value)
        return self._refused(name, f"({shown}), expected finite values from 0; white is used", _WHITE)

    def _value(self, name: str, count: int) -> tuple[float, ...] | None:
        """As many numbers as are expected, or None."""
        value = self.prim.GetAttribute(_PREFIX + name).Get(self.time) if _PREFIX + name in self.names else None
        if value is None:
            return None
        numbers = numbers_of(value, count)
        if numbers is not None:
            return numbers
        expected = "a number" if count == 1 else f"{count} numbers"
        return self._refused(name, f"{value!r}, expected {expected}; it is left out", None)

    def _refused(self, name: str, fault: str, default: Any) -> Any:
        self.tell(self.prim, _PREFIX + name, f"is {fault}")
        return default
