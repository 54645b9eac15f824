"""Reading attributes at one time, with a note of what varies, and warning once per fault.

A `Sampler` passes through the extraction of one thing (a mesh, a material, a light). Afterwards `Sampler.varies` says
whether another time could give another result; if not, the result serves for every frame.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from pxr import Usd

from fexel.errors import FexelWarning

__all__ = ["Faults", "Sampler"]


class Sampler:
    """Reads attribute values at `time` (None: the default time).

    Attributes
    ----------
    time : Usd.TimeCode
    varies : bool
        Whether any attribute read so far might have another value at another time.
    """

    def __init__(self, time: float | Usd.TimeCode | None):
        self.time = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        self.varies = False

    def get(self, attribute: Usd.Attribute, default: Any = None) -> Any:
        """The attribute's value; `default` where it has none, is blocked or does not exist."""
        if not attribute:
            return default
        self.varies = self.varies or attribute.ValueMightBeTimeVarying()
        value = attribute.Get(self.time)
        return default if value is None else value

    def array(self, attribute: Usd.Attribute, dtype: Any, width: int = 1) -> np.ndarray | None:
        """The attribute's array value: (N,) for `width` 1, else (N, width); a lone value is an array of one.

        None where it has no value, or one of another width.
        """
        value = self.get(attribute)
        if value is None:
            return None
        try:
            array = np.asarray(value, dtype=dtype)
        except (TypeError, ValueError):
            return None
        if width == 1:
            return array.reshape(-1) if array.ndim <= 1 else None
        return array.reshape(-1, width) if array.size == 0 or array.shape[-1] == width else None


class Faults:
    """Warns once per prim and fault."""

    def __init__(self) -> None:
        self._told: set[tuple[str, str]] = set()

    def warn(self, path: object, fault: str) -> None:
        """Warn that the prim or attribute at `path` has a `fault`: what was found, what was expected, what is done."""
        key = (str(path), fault)
        if key not in self._told:
            self._told.add(key)
            warnings.warn(f"{path}: {fault}", FexelWarning, stacklevel=2)
