"""Names, shapes and meanings of the AOVs (Hydra's names where Hydra has one).

``color`` and ``alpha`` are antialiased and blended. All others are data: float32, taken at the pixel's centre from the
nearest surface that is there (not cut out, opacity above zero), never averaged across edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from fexel.errors import FexelError

__all__ = ["AOVS", "Aov", "aov_defines", "checked_aovs", "data_aovs"]

_COUNTED = ("fetches", "filter")  # need shaders/lookup_counts.glsl


@dataclass(frozen=True)
class Aov:
    """One AOV: `channels` are the suffixes of its channels in a file; `background` is the value where nothing is drawn.

    `location_components` is the number of components of the target that the shader writes; 0 for an AOV that is part
    of the colour pass.
    """

    name: str
    channels: tuple[str, ...]
    background: float
    description: str
    location_components: int = 0


def _table(*aovs: Aov) -> dict[str, Aov]:
    return {aov.name: aov for aov in aovs}


AOVS = _table(
    Aov("color", ("R", "G", "B", "A"), 0.0, "linear Rec.709, premultiplied"),
    Aov("alpha", ("A",), 0.0, "coverage times opacity, 0 to 1"),
    Aov("depth", ("Z",), 1.0, "window depth, 0 (near) to 1 (far); 1 where there is nothing", 1),
    Aov("cameraDepth", ("Z",), 0.0, "distance along the view direction, world units; 0 where there is nothing", 1),
    Aov("normal", ("X", "Y", "Z"), 0.0, "shading normal, world axes, towards the camera", 4),
    Aov("Neye", ("X", "Y", "Z"), 0.0, "shading normal, camera axes", 4),
    Aov("position", ("X", "Y", "Z"), 0.0, "world units", 4),
    Aov("st", ("S", "T"), 0.0, "texture coordinates of the main texture, else of the mesh", 2),
    Aov("lod", ("L",), -1.0, "mip level of the top patch of the main texture; -1 where there is none", 1),
    Aov("patch", ("P",), -1.0, "index of the top patch of the main texture, 0 its base image, -1 where none", 1),
    Aov("footprint", ("X", "Y", "Z"), 0.0, "pixel in texels of the main texture: major, minor axis, angle of major", 4),
    Aov("fetches", ("F",), 0.0, "texels fetched for the main texture; 0 where there is none", 1),
    Aov("filter", ("I",), -1.0, "minification filter of the main texture, place in FILTERS; -1 where none", 1),
    Aov("decision", ("R", "G", "B"), 0.0, "colour of the camera's direction: along t, normal, along s", 4),
    Aov("primId", ("I",), -1.0, "index of the prim in Scene.prim_paths; -1 where there is nothing", 1),
)


def checked_aovs(names: Sequence[str]) -> tuple[Aov, ...]:
    """The AOVs of these names, each once, in order.

    Raises
    ------
    FexelError
        Unknown name, or none at all; the message lists the valid ones.
    """
    valid = " ".join(AOVS)
    if isinstance(names, str) or not names:
        raise FexelError(f"aovs: expected a sequence of names out of {valid}, got {names!r}")
    for name in names:
        if name not in AOVS:
            raise FexelError(f"unknown AOV {name!r}; valid are {valid}")
    return tuple(AOVS[name] for name in dict.fromkeys(names))


def data_aovs(aovs: Sequence[Aov]) -> tuple[Aov, ...]:
    """Those that need the data pass."""
    return tuple(aov for aov in aovs if aov.location_components)


def aov_defines(aovs: Sequence[Aov]) -> dict[str, int]:
    """Defines of a program that writes data AOVs, each at the location that is its place."""
    locations = {f"AOV_{aov.name.upper()}": location for location, aov in enumerate(aovs)}
    counts = {"LOOKUP_COUNTS": 1} if any(aov.name in _COUNTED for aov in aovs) else {}
    return {"DATA_AOVS": 1} | locations | counts
