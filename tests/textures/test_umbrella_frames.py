"""Frames of an animation: what a changed look shares with the frame before is neither made again nor kept twice."""

import numpy as np
import pytest

from bench.zipmap_stage import quad
from fexel.textures import umbrella_layers, umbrella_picture, umbrella_texels
from fexel.textures.kept_texels import KeptTexels
from fexel.textures.pyramid_cache import PyramidCache
from fexel.textures.system import TextureSystem
from fexel.textures.umbrella_picture import PictureTexels, picture_source
from fexel.textures.umbrella_texels import ArrangementSource, ArrangementTexels, ColorSource
from tests.textures.umbrella_squares import lawn_prim, placement, read, shown, squares

FRAMES = 6


@pytest.fixture
def crowd(rng):
    placements = [placement(*rng.random(2), 0.3) for _ in range(30)]
    stage = squares(placements, rng.uniform(0.1, 0.9, (30, 3)))
    lawn_prim(stage).CreateShadowOffsetAttr((0.03, -0.02))
    lawn_prim(stage).CreateShadowStrengthAttr(0.5)
    return stage


@pytest.fixture
def builds(monkeypatch):
    """Grids that lists were made for."""
    made = []
    build = umbrella_texels.build_cells
    monkeypatch.setattr(umbrella_texels, "build_cells", lambda *a, **o: made.append(a[1]) or build(*a, **o))
    return made


LOOKS = {
    "ColorBlend": lambda t: 1 - 0.1 * t,
    "ShadowStrength": lambda t: 0.1 + 0.1 * t,
    "ShadowOffset": lambda t: (0.01 * t + 0.01, -0.02),
}


@pytest.mark.parametrize("name", LOOKS)
def test_lists_and_colors_outlive_a_change_of_the_look(gl, crowd, builds, name):
    attribute = getattr(lawn_prim(crowd), f"Get{name}Attr")() or getattr(lawn_prim(crowd), f"Create{name}Attr")()
    for frame in range(FRAMES):
        attribute.Set(LOOKS[name](frame), frame)
    system = TextureSystem(gl)
    pictures = [shown(gl, crowd, system=system, time=frame) for frame in range(FRAMES)]
    system.release()
    assert len(builds) == 1
    for frame, picture in enumerate(pictures):
        assert np.abs(picture - shown(gl, crowd, time=frame)).max() < 1e-6
    assert np.abs(pictures[0] - pictures[-1]).max() > 0.02


def sources(stage, frames):
    for frame in range(frames):
        lawn_prim(stage).CreateMatricesAttr([placement(0.5 + 0.001 * frame, 0.5, 0.3)] * 30)
        arrangement = read(stage).arrangement.neutral
        yield ArrangementSource(arrangement, (8, 8), (0.01, 0.01), (True,), True)
        yield ColorSource(arrangement)


def test_what_is_remembered_of_past_frames_has_a_limit(crowd, monkeypatch):
    monkeypatch.setattr(umbrella_texels, "_MOST_FACTS", 10)
    kept = KeptTexels(50_000)
    reader = ArrangementTexels(kept)
    for source in sources(crowd, 40):
        reader.facts(source, "/Lawn")
    assert kept.nbytes <= 50_000
    assert reader._facts.nbytes <= 10


def test_texels_that_were_forgotten_are_read_again_as_they_were(crowd, monkeypatch):
    monkeypatch.setattr(umbrella_texels, "_MOST_FACTS", 1)
    small, large = ArrangementTexels(KeptTexels(1)), ArrangementTexels()
    for source in [*sources(crowd, 2), *sources(crowd, 2)]:
        facts = large.facts(source, "/Lawn")
        assert small.facts(source, "/Lawn") == facts
        assert small.row_bits(source) == large.row_bits(source)
        box = (0, 0, *facts.size)
        for _ in range(2):
            assert np.array_equal(small.window(source, "", 0, box), large.window(source, "", 0, box))


@pytest.mark.parametrize("name", LOOKS)
def test_picture_of_a_far_view_follows_the_look(gl, crowd, name):
    """Made anew for each frame, but for lists where they are the same."""
    attribute = getattr(lawn_prim(crowd), f"Create{name}Attr")()
    for frame in range(FRAMES):
        attribute.Set(LOOKS[name](frame), frame)
    system = TextureSystem(gl)
    far = quad((0, 0), (8, 8))
    pictures = [shown(gl, crowd, system=system, time=frame, draw=far) for frame in range(FRAMES)]
    system.release()
    for frame, picture in enumerate(pictures):
        assert np.abs(picture - shown(gl, crowd, time=frame, draw=far)).max() < 1e-6
    assert np.abs(pictures[0] - pictures[-1]).max() > 0.01


def test_lists_of_a_picture_are_made_once_for_all_strengths(crowd, monkeypatch):
    built = []
    build = umbrella_layers.build_cells
    monkeypatch.setattr(umbrella_layers, "build_cells", lambda *a, **o: built.append(a) or build(*a, **o))
    reader = PictureTexels(KeptTexels(), PyramidCache())
    for strength, offset, lists in ((0.25, 0.03, 1), (0.5, 0.03, 1), (0.75, 0.03, 1), (0.75, 0.04, 2), (0.0, 0.04, 3)):
        lawn_prim(crowd).GetShadowStrengthAttr().Set(strength)
        lawn_prim(crowd).GetShadowOffsetAttr().Set((offset, -0.02))
        source = picture_source(read(crowd), ("repeat", "repeat"))
        reader.window(source, "/Lawn", 0, (0, 0, *source.size))
        assert len(built) == lists


def test_picture_of_many_cells_takes_fewer_samples(crowd, monkeypatch):
    sources = []
    for most in (1 << 18, 1):
        monkeypatch.setattr(umbrella_picture, "_MOST_SAMPLES", most)
        source = picture_source(read(crowd), ("repeat", "repeat"))
        reader = PictureTexels(KeptTexels(), PyramidCache())
        sources.append(reader.window(source, "/Lawn", 0, (0, 0, *source.size)).astype(float)[1:-1, 1:-1])
    assert sources[0].shape == sources[1].shape
    assert sources[0].mean() == pytest.approx(sources[1].mean(), rel=0.01)
    assert 0 < np.abs(sources[0] - sources[1]).mean() < 0.1 * sources[0].std()
