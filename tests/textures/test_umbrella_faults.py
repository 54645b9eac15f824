"""Faulty umbrellas are said and left out; the picture is that of the others, down to what numbers a GPU can hold."""

import warnings

import numpy as np
import pytest

from fexel.errors import FexelWarning
from fexel.textures import umbrella_texels
from tests.textures.umbrella_squares import SOIL, SQUARE, add_patch, lawn_prim, placement, shown, squares

RED, GREEN = (0.5, 0.0, 0.0), (0.0, 0.5, 0.0)
NAN = float("nan")
FAULTS = {
    "no points": lambda patch: patch.GetPrim().RemoveProperty("points"),
    "three points": lambda patch: (patch.CreatePointsAttr(SQUARE[:3]), patch.CreateTexCoordsAttr(SQUARE[:3])),
    "texCoords too short": lambda patch: (patch.CreateFileAttr("/nowhere.png"), patch.CreateTexCoordsAttr(SQUARE[:3])),
    "NaN in texCoords": lambda patch: (patch.CreateFileAttr("/nowhere.png"), patch.CreateTexCoordsAttr([(NAN, 0)] * 5)),
    "NaN in points": lambda patch: patch.CreatePointsAttr([(NAN, 0), *SQUARE[1:]]),
}


def quietly(function, *arguments):
    """The result and what was said."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = function(*arguments)
    return result, [str(warning.message) for warning in caught]


@pytest.mark.parametrize("used", [True, False], ids=["used", "unused"])
@pytest.mark.parametrize("place", [0, 1, 2], ids=["first", "middle", "last"])
@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_patch_leaves_the_others_as_they_are(gl, fault, place, used):
    good = [number for number in range(3) if number != place]
    stage = squares([placement(0.25, 0.5, 0.25), placement(0.75, 0.5, 0.25)], [RED, GREEN], names="ABC")
    lawn_prim(stage).CreatePatchIndicesAttr(good)
    alone = shown(gl, stage)
    FAULTS[fault](add_patch(stage, "ABC"[place]))
    if used:
        lawn_prim(stage).CreatePatchIndicesAttr([*good, place])
        lawn_prim(stage).CreateMatricesAttr([placement(0.25, 0.5, 0.25), placement(0.75, 0.5, 0.25), placement(0, 0)])
        lawn_prim(stage).GetPrim().RemoveProperty("colors")
        others, _ = quietly(shown, gl, stage)
        lawn_prim(stage).CreatePatchIndicesAttr([good[0], place, good[1]])
        lawn_prim(stage).CreateMatricesAttr([placement(0.25, 0.5, 0.25), placement(0, 0), placement(0.75, 0.5, 0.25)])
        alone = others
    picture, messages = quietly(shown, gl, stage)
    assert any(f"/Lawn/{'ABC'[place]}." in message for message in messages)
    assert np.abs(picture - alone).max() < 1e-3
    assert np.abs(picture[32, 16, :3] - SOIL[:3]).max() > 0.05
    assert np.abs(picture[32, 48, :3] - SOIL[:3]).max() > 0.05


def test_nothing_but_a_faulty_patch_shows_the_background(gl):
    stage = squares([placement(0.5, 0.5, 0.5)], [RED])
    FAULTS["no points"](add_patch(stage, "Square"))
    lawn_prim(stage).GetPrim().RemoveProperty("colors")
    picture, messages = quietly(shown, gl, stage)
    assert len(messages) == 1
    assert np.abs(picture - SOIL).max() < 1e-3


# Numbers that a GPU can hold


def test_colors_beyond_half_floats_are_as_those_at_the_limit(gl):
    placements = [placement(0.25, 0.5, 0.25), placement(0.75, 0.5, 0.25)]
    stage = squares(placements, [(1e30, -1e30, 0.25), (-3e38, 1e5, 0.5)])
    picture = shown(gl, stage)
    assert np.abs(picture[32, 16] - (1, 0, 0.25, 1)).max() < 1e-3
    assert np.abs(picture[32, 48] - (0, 1, 0.5, 1)).max() < 1e-3


def crowd(rng, count=40):
    placements = [placement(*rng.random(2), 0.3) for _ in range(count)]
    return squares(placements, rng.uniform(0.1, 0.9, (count, 3)))


def test_lists_that_are_too_long_for_exact_addresses_are_made_for_coarser_cells(gl, rng, monkeypatch):
    stage = crowd(rng)
    whole = shown(gl, stage)
    monkeypatch.setattr(umbrella_texels, "_MOST_TEXELS", 1200)
    sizes = []
    build = umbrella_texels.build_cells
    monkeypatch.setattr(umbrella_texels, "build_cells", lambda *a, **o: sizes.append(a[1]) or build(*a, **o))
    picture = shown(gl, stage)
    assert len(sizes) > 1
    assert np.prod(sizes[-1]) < np.prod(sizes[0])
    assert np.abs(picture - whole).max() < 2e-3


def test_more_umbrellas_than_a_list_can_hold_show_those_in_front(gl, monkeypatch):
    placements = [placement(0.25, 0.5, 0.25), *[placement(0.75, 0.5, 0.25 - 0.001 * i) for i in range(100)]]
    stage = squares(placements, [RED] + [GREEN] * 100)
    monkeypatch.setattr(umbrella_texels, "_MOST_TEXELS", 200)
    with pytest.warns(FexelWarning, match=r"/Lawn: \d+ umbrellas, expected at most \d+; those in front are drawn"):
        picture = shown(gl, stage)
    assert np.isfinite(picture).all()
    assert np.abs(picture[32, 16, :3] - RED).max() < 1e-3


def test_more_colors_than_a_float_can_number_are_left_out(gl, rng, monkeypatch):
    stage = crowd(rng)
    lawn_prim(stage).CreateColorBlendAttr(0.0)
    plain = shown(gl, stage)
    lawn_prim(stage).CreateColorBlendAttr(1.0)
    colored = shown(gl, stage)
    monkeypatch.setattr(umbrella_texels, "_MOST_COLORS", 199)
    with pytest.warns(FexelWarning, match="/Lawn: 200 vertices of umbrellas, expected at most 199; their colours"):
        picture = shown(gl, stage)
    assert np.abs(colored - plain).max() > 0.1
    assert np.abs(picture - plain).max() < 1e-3
