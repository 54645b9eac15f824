"""From photos to a ground as data, before anything is written.

1. `umbrella_elements`: what each photo shows; what is no whole element is left out and told.
2. `umbrella_base`: contour, centre and texture of each.
3. `umbrella_morph`, `umbrella_arrange`, `umbrella_color`: other shapes, places, other colours.
4. `umbrella_background`: what lies behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Tf

from fexel.errors import FexelError
from fexel.textures.umbrella_arrangement import Arrangement, Shape
from fexel_tools.phases import Phases
from fexel_tools.umbrella_advice import warn_of_centre, warn_of_hints, warn_of_references, warn_of_tolerance
from fexel_tools.umbrella_arrange import arrange, check_arrange_options
from fexel_tools.umbrella_background import Background, choose_background
from fexel_tools.umbrella_base import BaseOptions, BaseUmbrella, make_bases
from fexel_tools.umbrella_color import ColorOptions, color_offsets
from fexel_tools.umbrella_elements import Element, Elements, find_elements
from fexel_tools.umbrella_hints import read_hints
from fexel_tools.umbrella_morph import MorphOptions, with_morphs
from fexel_tools.umbrella_options import UmbrellaOptions

__all__ = ["STEPS", "Ground", "compute_ground", "read_sources"]

STEPS = ("read", "bases", "diversify", "textures", "stage", "fallback", "levels", "measure")
"""Phases of a ground, in order; `read_sources` is the first, `compute_ground` has the next two."""

_RESERVED = ("Fallback", "Level", "background", "fallback", "level", "arrangement")  # other prims and files begin so
_REFERENCE_TEXELS = 64  # colours of references are taken at low frequency
_UNREAD = (0, 0)  # size of a photo that cannot be read


@dataclass(frozen=True, eq=False)
class Ground:
    """A ground as computed, not yet written.

    Attributes
    ----------
    sources : tuple of Elements
        One per file.
    elements : tuple of Element
        One per base.
    bases : tuple of BaseUmbrella
    names : tuple of str
        Of prims and files, one per base.
    arrangement : Arrangement
        Its shapes have no images.
    background : Background
    """

    sources: tuple[Elements, ...]
    elements: tuple[Element, ...]
    bases: tuple[BaseUmbrella, ...]
    names: tuple[str, ...]
    arrangement: Arrangement
    background: Background

    @property
    def textures(self) -> tuple[NDArray[np.float32], ...]:
        """(h, w, 4) of each base, linear (or data), straight alpha."""
        return tuple(base.texture for base in self.bases)

    @property
    def behind(self) -> NDArray[np.float32] | tuple[float, ...]:
        """The background as `fexel_tools.umbrella_raster` takes it."""
        return self.background.color if self.background.picture is None else self.background.picture


def compute_ground(sources: Sequence[Elements], options: UmbrellaOptions, phases: Phases | None = None) -> Ground:
    """From what photos show to a ground.

    Parameters
    ----------
    sources : sequence of Elements
        From `read_sources`: at least one element in all.
    options : UmbrellaOptions
    phases : Phases, optional
        Is told how long the phases take.

    Raises
    ------
    FexelError
        An option is wrong, or a given file cannot be read.
    """
    phases = phases or Phases("umbrellas", STEPS)
    with phases("bases"):
        elements, bases = _bases(sources, options)
    with phases("diversify"):
        check_arrange_options(options.arrange, len(bases))
        if "shape" in options.diversify:
            bases = with_morphs(bases, MorphOptions(1.0, options.vertices, options.seed))
        arrangement = _arranged(bases, options)
        background = choose_background(
            options.background,
            sources,
            options.grid,
            is_data=options.is_data,
            cell_texels=options.background_size,
        )
    return Ground(tuple(sources), tuple(elements), tuple(bases), _names(bases), arrangement, background)


def _arranged(bases: Sequence[BaseUmbrella], options: UmbrellaOptions) -> Arrangement:
    placed = arrange(bases, options.arrange)
    colors = np.zeros((0, 3), np.float32)
    if "color" in options.diversify and not options.is_data and options.color_blend > 0.0:
        references = _references(options)
        colors = color_offsets(bases, placed.shape_of, ColorOptions(seed=options.seed), references)
    return Arrangement(
        shapes=tuple(Shape(base.points, base.morph_points, base.tex_coords) for base in bases),
        shape_of=placed.shape_of,
        matrices=placed.matrices,
        morphs=placed.morphs,
        colors=colors,
        grid=options.grid,
        color_blend=options.color_blend,
        shadow_offset=(options.shadow[0] / options.grid[0], options.shadow[1] / options.grid[1]),
        shadow_strength=0.0 if options.is_data else options.shadow_strength,
        coverages=np.ones(len(placed.shape_of)),
    )


def _names(bases: Sequence[BaseUmbrella]) -> tuple[str, ...]:
    """Names of prims and files: valid, unique without regard to case, none that a texture has besides."""
    names: list[str] = []
    taken: set[str] = set()
    for base in bases:
        stem = Tf.MakeValidIdentifier(base.name)
        stem = f"Element_{stem}" if stem.startswith(_RESERVED) else stem
        name, number = stem, 2
        while name.lower() in taken:
            name, number = f"{stem}_{number}", number + 1
        taken.add(name.lower())
        names.append(name)
    return tuple(names)


def read_sources(files: Sequence[str], options: UmbrellaOptions) -> list[Elements]:
    """What each photo shows. One that cannot be read has no elements and says why, as long as another has some.

    Raises
    ------
    FexelError
        No file has an element.
    """
    with ThreadPoolExecutor(options.jobs) as pool:
        found = list(pool.map(lambda file: _found(file, options), files))
    if not any(source.elements for source in found):
        what = "" if found[0].size == _UNREAD else "no element found: "
        more = f" (nor has any of {len(files) - 1} other files an element)" if len(files) > 1 else ""
        raise FexelError(f"{files[0]}: {what}{found[0].reason}{more}")
    return found


def _bases(sources: Sequence[Elements], options: UmbrellaOptions) -> tuple[list[Element], list[BaseUmbrella]]:
    elements = [element for source in sources for element in source.elements]
    hints = read_hints(options.hints) if options.hints else {}
    warn_of_hints(options.hints, hints, elements)
    warn_of_centre(options.centre, hints, elements)
    chosen = BaseOptions(
        vertices=options.vertices,
        tolerance_px=options.tolerance,
        texture_size=options.texture_size,
        centre=options.centre,
        hints=hints,
    )
    with ThreadPoolExecutor(options.jobs) as pool:
        bases = list(pool.map(lambda element: make_bases([element], chosen)[0], elements))
    warn_of_tolerance(elements, bases, options)
    return elements, bases


def _references(options: UmbrellaOptions) -> list[BaseUmbrella]:
    """Elements whose colours are taken; none without references."""
    if not options.references:
        return []
    shown = replace(options, kind="auto", raw=False, drives="")
    sources = read_sources(options.references, shown)
    warn_of_references(sources)
    coarse = BaseOptions(texture_size=_REFERENCE_TEXELS)
    return make_bases([element for source in sources for element in source.elements], coarse)


def _found(file: str, options: UmbrellaOptions) -> Elements:
    try:
        return find_elements(file, kind=options.kind, is_data=options.is_data)
    except FexelError as error:
        return Elements(Path(file), options.kind, _UNREAD, (), reason=str(error).removeprefix(f"{file}: "))
