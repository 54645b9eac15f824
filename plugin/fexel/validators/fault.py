"""What a check yields: a plain value, turned into USD's own error type by `fexel.validators.registration`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pxr import Sdf, Usd

__all__ = ["Fault", "authored_values"]


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes
    ----------
    path : Sdf.Path
        Prim, or property of a prim.
    message : str
        What was found and what was expected, one line.
    is_error : bool
        The picture is wrong or cannot be made; otherwise a warning.
    """

    path: Sdf.Path
    message: str
    is_error: bool = True


def authored_values(attribute: Usd.Attribute) -> list[tuple[str, Any]]:
    """Every value that a texture's attribute takes, each with a note that names its time ('' for the default)."""
    if not attribute or not attribute.HasAuthoredValue():
        return []
    samples = attribute.GetTimeSamples()
    if samples:
        return [(f" at time {time:g}", attribute.Get(time)) for time in samples]
    value = attribute.Get()
    return [] if value is None else [("", value)]
