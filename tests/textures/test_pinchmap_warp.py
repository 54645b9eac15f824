"""shaders/pinchmap_warp.glsl against its float64 twin, from minification to a million pixels per texel."""

import numpy as np
import pytest

from bench.pinchmap_probe import Probe, quad_gradient, random_pinchmap, view_of
from fexel import mipmaps
from fexel.renderer.program import load_shader
from fexel.textures.pinchmap_twin import edge, picture_levels, sample_pinchmap

HARD, SOFT = 1e-4, 1e-3
PIXELS = 256
# Above it a sampler's coordinates and weights show, and differences between pixels are rounding errors.
BILINEAR_LIMIT = 256.0
MAGNIFICATIONS = (0.25, 0.7, 1.5, 5.0, 32.0, 200.0, 3e3, 3e4, 1e6)
WAYS = [(m, exact) for m in MAGNIFICATIONS for exact in (False, True) if exact or m < BILINEAR_LIMIT]


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(20050904)
    pinchmap, signal = random_pinchmap(rng, 24, 17, 1)
    return pinchmap, picture_levels(pinchmap, mipmaps.pyramid(signal))


def views(rng, pinchmap, magnification, count=2):
    for _ in range(count):
        yield view_of(rng, pinchmap, magnification, PIXELS)


def compare(gl, scene, view, exact, antialias, line_width=0.0, texel_type="snorm"):
    """Differences of shader and twin by pixel, and k^B - gamma^B there."""
    pinchmap, levels = scene
    probe = Probe(gl, pinchmap, levels, PIXELS, texel_type)
    rendered = probe.render(view, exact=exact, antialias=antialias, line_width=line_width)
    probe.release()
    st, jacobian = view.places(pinchmap, PIXELS)
    distance = edge(pinchmap, st)
    gradient = None if exact else quad_gradient(distance.reshape(PIXELS, PIXELS))
    options = {"antialias": antialias, "line_width": line_width, "line_color": (0.2, 0.1, 0.4, 0.8)}
    expected = sample_pinchmap(pinchmap, levels, st, jacobian, gradient=gradient, **options)
    assert np.isfinite(rendered).all()
    return np.abs(rendered.reshape(-1, 4) - expected).max(1), distance


@pytest.mark.parametrize(("magnification", "exact"), WAYS)
def test_hard_edges_equal_the_twin_at_any_magnification(gl, rng, scene, magnification, exact):
    flips = []
    for view in views(rng, scene[0], magnification):
        difference, distance = compare(gl, scene, view, exact, 0.0)
        assert difference[np.abs(distance) > 1e-4].max(initial=0) <= HARD
        flips.append((difference > 0.02).mean())  # on the other side of the edge
    assert np.mean(flips) <= 1e-4


@pytest.mark.parametrize(("magnification", "exact"), WAYS)
def test_antialiased_edges_equal_the_twin_at_any_magnification(gl, rng, scene, magnification, exact):
    for view in views(rng, scene[0], magnification):
        difference, distance = compare(gl, scene, view, exact, 1.0)
        assert difference[np.abs(distance) > 1e-4].max(initial=0) <= SOFT


@pytest.mark.parametrize("antialias", [0.0, 1.0, 2.5])
@pytest.mark.parametrize("magnification", [0.4, 1.5, 5.0, 32.0])
def test_solid_lines_equal_the_twin(gl, rng, scene, magnification, antialias):
    for view in views(rng, scene[0], magnification):
        difference, distance = compare(gl, scene, view, True, antialias, line_width=0.3)
        off = difference[np.abs(distance) > 1e-4] > SOFT
        assert off.mean() <= (2e-4 if antialias == 0 else 0)  # the line's own edges may round either way


@pytest.mark.parametrize("k", [0, 1, 3])
def test_signals_of_any_fineness_equal_the_twin(gl, rng, k):
    pinchmap, signal = random_pinchmap(rng, 9, 14, k)
    levels = mipmaps.pyramid(signal)
    for view in views(rng, pinchmap, 20.0):
        difference, distance = compare(gl, (pinchmap, levels), view, True, 1.0)
        assert difference[np.abs(distance) > 1e-4].max() <= SOFT


def test_float_texels_equal_the_twin(gl, rng):
    pinchmap, signal = random_pinchmap(rng, 9, 14, 1, reach=0.999)
    pinchmap[..., :2] *= rng.uniform(0, 1, pinchmap.shape[:2])[..., None]  # any strength
    levels = mipmaps.pyramid(signal)
    for view in views(rng, pinchmap, 20.0):
        difference, distance = compare(gl, (pinchmap, levels), view, False, 1.0, texel_type="float")
        assert difference[np.abs(distance) > 1e-4].max() <= SOFT


@pytest.mark.parametrize("exact", [False, True])
def test_the_pinch_compiles_as_glsl_es(gl, exact):
    defines = {"PINCHMAP_EXACT": exact, "PINCHMAP_LINES": True, "PINCHMAP_MAGNIFIED": False}
    head = "#version 300 es\nprecision highp float;\nprecision highp sampler2D;"
    sources = [load_shader(name, defines).text for name in ("fullscreen.vert", "pinchmap_plain.frag")]
    vertex, fragment = (text.replace("#version 330 core", head) for text in sources)
    gl.program(vertex_shader=vertex, fragment_shader=fragment).release()
