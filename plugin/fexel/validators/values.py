"""Values against the schema's own limits and tokens."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from pxr import Usd

from fexel.validators.fault import Fault, authored_values
from fexel.validators.prim_validator import ANY, PrimValidator

__all__ = ["VALIDATORS", "check_limits", "limits_of"]


def limits_of(attribute: Usd.Attribute) -> dict[str, Any]:
    """The hard limits that the schema gives, of numbers; empty where it gives none."""
    return (attribute.GetMetadata("limits") or {}).get("hard") or {}


def check_limits(prim: Usd.Prim) -> Iterator[Fault]:
    """Authored values of fexel's attributes outside the hard limits or the allowed tokens that the schema gives."""
    for attribute in prim.GetAuthoredAttributes():
        allowed = attribute.GetMetadata("allowedTokens")
        hard = limits_of(attribute)
        if not attribute.IsDefined() or attribute.IsCustom() or not (allowed or hard):
            continue
        for when, value in authored_values(attribute):
            if allowed and not (isinstance(value, str) and value in allowed):
                message = f"{value}, expected one of {', '.join(allowed)}{when}"
                yield Fault(attribute.GetPath(), message)
            elif hard and not isinstance(value, int | float):
                yield Fault(attribute.GetPath(), f"{value!r}, expected a number{when}")
            elif hard and not _within(value, hard):
                yield Fault(attribute.GetPath(), f"{value:g}, expected {_range(hard)}{when}")


def _within(value: Any, hard: dict[str, Any]) -> bool:
    """NaN lies in no range."""
    return bool(hard.get("minimum", value) <= value <= hard.get("maximum", value))


def _range(hard: dict[str, Any]) -> str:
    low, high = hard.get("minimum"), hard.get("maximum")
    if high is None:
        return f"at least {low:g}"
    return f"{low:g} to {high:g}" if low is not None else f"at most {high:g}"


VALIDATORS = (
    PrimValidator("fexel:Limits", "Values must lie within the limits and tokens of the schema.", ANY, check_limits),
)
