"""Contrast, brightness and attenuation of a material's textures: defines and uniforms of shaders/texture_adjust.glsl.

Values are uniforms, so that animating them compiles nothing; only which textures have any is compiled in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fexel.filters.minification import Minification
from fexel.textures.kind import Part

__all__ = ["adjustment"]

_LARGEST_RATE = 1e30  # of attenuation per scene unit: a distance of 0 times infinity would be NaN


def adjustment(asked: Sequence[Minification]) -> Part:
    """Of textures by slot; nothing at all where none asks for any."""
    defines: dict[str, int | str] = {}
    for name, of_slot in (("TONED", [m.toned for m in asked]), ("ATTENUATED", [m.attenuates for m in asked])):
        if any(of_slot):
            defines[f"TEXTURE_{name}"] = sum(int(used) << slot for slot, used in enumerate(of_slot))
    if not defines:
        return Part({})
    rates = [min(1.0 / m.attenuation_distance, _LARGEST_RATE) for m in asked]
    tones = [(m.contrast, m.brightness, rate, 0.0) for m, rate in zip(asked, rates, strict=True)]
    colors = [(*m.attenuation_color, 0.0) for m in asked]
    return Part(defines, {"textureTone": np.array(tones), "textureHaze": np.array(colors)})
