"""Which of the portable filters each texture of a stage needs: ``fexel minify --filter auto``.

What the image holds and at which footprints the stage's cameras see it foretell the error of every filter
(`fexel.filters.auto`), as a root mean square over each picture; the worst picture counts. Chosen is the filter that
fetches least of those below the bound, at equal cost the one that takes least memory. Anisotropic is what is drawn
unless more probes are asked for. Where none is good enough, what
comes within one decibel of the best counts as good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from fexel.errors import FexelError
from fexel.filters import PORTABLE_FILTERS, auto, fipmap, ripmap
from fexel.filters.content import Content, measure
from fexel.renderer.api import DEFAULT_ANISOTROPY
from fexel.schema.wrapper import is_a
from fexel.textures import extract_texture
from fexel.textures.footprint import Footprint
from fexel.textures.image_source import image_source
from fexel.textures.inputs import Inputs
from fexel.textures.pyramid_cache import PyramidCache
from fexel_tools.baking import texture_baker
from fexel_tools.minify_textures import holds_data
from fexel_tools.minify_views import SeenFootprints

__all__ = ["BOUND_DB", "UNSEEN", "FilterChoice", "choose_filter", "unjudged"]

BOUND_DB = 40.0
"""Peak signal-to-noise ratio over a picture that is good enough by default: an error of 2.5 of 255 steps."""

_PICTURE = 2048  # texels along the longer side of what stands for a fexel texture
_LEAST = 64.0  # pixels: of a picture that shows less of a texture nothing is said
_WORTH_DB = 1.0
_MARGIN_DB = 2.5  # by which a picture may be worse than foretold; measured on a painting, less on charts and noise


@dataclass(frozen=True)
class FilterChoice:
    """A filter and why.

    Attributes
    ----------
    filter : str
    reason : str
    predicted_db : dict of str to float
        Of each portable filter, in the picture where it is worst; empty where nothing could be foretold.
    """

    filter: str
    reason: str
    predicted_db: dict[str, float] = field(default_factory=dict)


UNSEEN = FilterChoice("anisotropic", "no camera sees it")


def unjudged(reason: str) -> FilterChoice:
    """What a texture gets of which nothing can be foretold."""
    return FilterChoice("anisotropic", f"cannot be judged: {reason}")


def choose_filter(texture: Usd.Prim, pictures: Sequence[SeenFootprints], bound_db: float) -> FilterChoice:
    """The cheapest filter for a texture.

    Parameters
    ----------
    texture : Usd.Prim
        A fexel texture or a UsdUVTexture.
    pictures : sequence of SeenFootprints
        How each picture sees it.
    bound_db : float
        Predicted peak signal-to-noise ratio that is good enough.
    """
    pictures = [seen for seen in pictures if seen.pixels * len(seen.jacobian) >= _LEAST]
    if not pictures:
        return UNSEEN
    found = _content(texture)
    if found is None:
        return unjudged("it has no image that can be read")
    content, size = found
    jacobians = [_texels(seen.jacobian, size) for seen in pictures]
    errors = [auto.predict(jacobian, content) for jacobian in jacobians]
    worst = {token: max(_rms(error[token]) for error in errors) for token in PORTABLE_FILTERS}
    decibels = {token: float(auto.decibels(worst[token])) for token in PORTABLE_FILTERS}
    cost = _fetches(np.concatenate(jacobians))
    enough = min(bound_db + _MARGIN_DB, max(decibels.values()) - _WORTH_DB)
    by_memory = (token for token in PORTABLE_FILTERS if decibels[token] >= enough)  # least first, whatever the wrap
    chosen = min(by_memory, key=lambda token: round(cost[token]))
    return FilterChoice(chosen, f"predicted {decibels[chosen]:.1f} dB", decibels)


def _content(texture: Usd.Prim) -> tuple[Content, tuple[int, int]] | None:
    """What a texture's image, or the picture that stands for it, holds; and its width and height."""
    path, time = str(texture.GetPath()), Usd.TimeCode.EarliestTime()
    if is_a(texture, "FexelTexture"):
        baker = texture_baker(*extract_texture(texture, time), path)
        try:
            picture = baker.bake(*baker.size(_PICTURE))
        except FexelError:
            return None
        return Content.of(picture, encoded=not holds_data(texture)), (picture.shape[1], picture.shape[0])
    cache, source = PyramidCache(), image_source(Inputs(texture, time), nested=False)
    facts = cache.facts(source, path)
    return None if facts.info is None else (measure(cache, source, path), facts.size)


def _texels(jacobian: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.float64]:
    """From texture coordinates, t up, to texels, y down."""
    return jacobian * np.array([[size[0]], [-size[1]]], np.float64)


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _fetches(jacobian: NDArray[np.float64]) -> dict[str, float]:
    """Texels fetched per pixel, on average; all pictures count alike."""
    return {
        "mipmap": 8.0,
        "anisotropic": float(8.0 * np.mean(Footprint.of(jacobian).probes(DEFAULT_ANISOTROPY))),
        "ripmap": 4.0 * ripmap.PROBES,
        "fipmap": 4.0 * fipmap.PROBES,
    }
