"""Memory of minification filters: all that a filter may read, and what a view of a repeated texture really loads."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.harness import Row
from fexel.errors import FexelError
from fexel.filters import FILTERS
from fexel.renderer.context import GLContext
from fexel_tools.filter_lookup import look_up
from fexel_tools.filter_measure import COMPARED, memory_ratio
from fexel_tools.filter_subject import drawn_subject
from fexel_tools.filter_textures import line_chart
from fexel_tools.filter_views import FilterView

NAME = "minification memory"
_WRAPS = ("repeat", "mirror", "clamp")
_VIEW = FilterView(5.0, 30.0)
_KNOWN = {"mipmap": 1.33, "anisotropic": 1.33, "ripmap": 4.0, "fipmap": 12.0}


def rows(quick: bool) -> Iterator[Row]:
    """By filter: the whole of it, per wrap mode; the texels resident for one view."""
    for wrap in _WRAPS:
        for token in COMPARED:
            ratio = memory_ratio(token, (1024, 1024), (wrap, wrap))
            reference = f"an earlier measurement: {_KNOWN[token]:g}" if wrap == "repeat" and token in _KNOWN else ""
            yield Row(f"{token}: all that it may read", f"1024 x 1024, {wrap}", ratio, "x image", reference=reference)
    yield from _resident(512 if quick else 1024)


def _resident(size: int) -> Iterator[Row]:
    """Bytes on the GPU for a view, of pages that fit what is asked for; none without OpenGL."""
    with tempfile.TemporaryDirectory() as folder:
        subject = drawn_subject("chart", line_chart(size), Path(folder))
        try:
            with GLContext() as gl:
                for token in FILTERS:
                    yield Row(
                        f"{token}: resident for one view",
                        f"{size} x {size}, {_VIEW.elevation:g} degrees, azimuth {_VIEW.azimuth:g}",
                        _loaded(gl, subject.source, token, size) / (4 * size * size),
                        "x image",
                        note="pages are square and grow by doubling; 4 bytes per texel",
                    )
        except FexelError:
            return


def _loaded(gl, source, token: str, size: int) -> int:
    xy = np.random.default_rng(5).uniform(0, size, (256, 2))
    jacobian = _VIEW.jacobian
    seen = (jacobian[None, None], np.zeros((1, 2)), np.ones((1, 2)))
    looked = look_up(gl, source, token, xy, np.broadcast_to(jacobian, (256, 2, 2)), anisotropy=16.0, seen=seen)
    return looked.stats["texture_bytes"]
