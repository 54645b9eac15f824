"""Errors and warnings that fexel raises on purpose.

Every message names the place (prim path and attribute, or file), what was found and what was expected.
"""

from __future__ import annotations

__all__ = ["FexelError", "FexelWarning"]


class FexelError(Exception):
    """An expected failure: bad input, a missing file, no usable OpenGL. One line, fit to print as it is."""


class FexelWarning(UserWarning):
    """Something in a stage is damaged or approximated; the picture goes on with a fallback."""
