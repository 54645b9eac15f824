"""Texels that readers have made, kept while they are used, up to a limit for all readers of a pool together."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from typing import Any

__all__ = ["KeptTexels"]

_MOST_BYTES = 512 * 2**20


class KeptTexels:
    """What was used last stays; what was used longest ago goes first.

    Parameters
    ----------
    most_bytes : int
        The newest stays however large it is.
    """

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._most = most_bytes
        self._kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self.nbytes = 0

    def __contains__(self, key: Hashable) -> bool:
        return key in self._kept

    def get(self, key: Hashable) -> Any:
        """What is kept, which counts as used; else None."""
        if key not in self._kept:
            return None
        self._kept.move_to_end(key)
        return self._kept[key][0]

    def keep(self, key: Hashable, texels: Any, nbytes: int) -> None:
        """Keep, in place of what had this key."""
        self.nbytes += nbytes - self._kept.pop(key, (None, 0))[1]
        self._kept[key] = (texels, nbytes)
        while self.nbytes > self._most and len(self._kept) > 1:
            self.nbytes -= self._kept.popitem(last=False)[1][1]
