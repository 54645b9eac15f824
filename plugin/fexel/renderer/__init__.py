"""The renderer: `Renderer` and `render` for stages; passes, programs and files below."""

from __future__ import annotations

from fexel.renderer.api import Renderer, render
from fexel.renderer.context import GLContext

__all__ = ["GLContext", "Renderer", "render"]
