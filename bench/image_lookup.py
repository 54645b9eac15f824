"""Images looked up on the GPU at given places with given footprints: `fexel_tools.filter_lookup`, for benchmarks."""

from __future__ import annotations

from fexel_tools.filter_lookup import Looked, look_up

__all__ = ["Looked", "look_up"]
