"""What is done to filtered colours of a material's textures: defines and uniforms of shaders/texture_adjust.glsl.

Values are uniforms, so that animating them compiles nothing; only which textures have any is compiled in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fexel.filters.minification import Minification
from fexel.textures.kind import Part

__all__ = ["adjustment"]

_LARGEST_RATE = 1e30  # of attenuation per scene unit: a distance of 0 times infinity would be NaN


def adjustment(asked: Sequence[Minification], renormalised: Sequence[bool]) -> Part:
    """Of textures by slot, and which of them are vectors that are made as long as 1; nothing where there are none."""
    defines: dict[str, int | str] = {}
    toned, attenuated = [m.toned for m in asked], [m.attenuates for m in asked]
    for name, of_slot in (("TONED", toned), ("ATTENUATED", attenuated), ("RENORMALISED", renormalised)):
        if any(of_slot):
            defines[f"TEXTURE_{name}"] = sum(int(used) << slot for slot, used in enumerate(of_slot))
    if not defines:
        return Part({})
    rates = [min(1.0 / m.attenuation_distance, _LARGEST_RATE) for m in asked]
    tones = [(m.contrast, m.brightness, rate, 0.0) for m, rate in zip(asked, rates, strict=True)]
    colors = [(*m.attenuation_color, 0.0) for m in asked]
    return Part(defines, {"textureTone": np.array(tones), "textureHaze": np.array(colors)})
