"""Rendered pinchmaps against the float64 twin: any magnification, wrap mode, format; nested; minified to a pixel."""

import numpy as np
import pytest

from bench.pinchmap_texture import define_pinchmap, pinchmap_stage, random_pinchmap, save_texels, two_sides
from bench.zipmap_stage import (
    Patch,
    front_view,
    pixel_st,
    quad,
    render_texture,
    save,
    tilted_view,
    zipmap_stage,
    zipmap_texture,
)
from fexel import homography, mipmaps
from fexel.textures.pinchmap_encoding import encode_texels
from fexel.textures.pinchmap_twin import edge, picture_levels, pinch, sample_pinchmap
from fexel.textures.system import TextureSystem

SHAPE = (12, 16)
# Signals are float files of multiples of 1/256, which half floats hold, so that what differs is the lookup.
STEP = 256


class Made:
    """A pinchmap and its signal as files and as arrays."""

    def __init__(self, rng, folder, octaves=1, wrap=("clamp", "clamp"), bits=8, opaque=True, shape=SHAPE):
        self.wrap = wrap
        self.pinchmap, mask = random_pinchmap(rng, shape, wrap)
        self.signal = two_sides(rng, mask, octaves, opaque) / STEP
        self.signal[..., 3] = np.where(self.signal[..., 3] > 0.9, 1.0, self.signal[..., 3])
        stored = self.pinchmap.astype(np.float32) if bits == 32 else encode_texels(self.pinchmap, bits)
        self.files = (
            save_texels(folder / "signal.tif", self.signal.astype(np.float32)),
            save_texels(folder / ("pinchmap.exr" if bits == 32 else "pinchmap.png"), stored),
        )
        if bits == 16:
            self.pinchmap = np.round(self.pinchmap * 32767) / 32767
        self.signal[..., :3] *= self.signal[..., 3:]

    def texture(self, **inputs):
        stage = pinchmap_stage(*self.files, wrapS=self.wrap[0], wrapT=self.wrap[1], **inputs)
        return zipmap_texture(stage, "/Pinchmap")

    def expected(self, view, st, jacobian, gradient=None, **inputs):
        """(H, W, 4) by the twin, with mip levels as the renderer has them."""
        levels = [self.signal, *mipmaps.pyramid(self.signal)[1:]]
        lines = {"line_width": inputs.get("line_width", 0.0), "line_color": inputs.get("line_color", (0, 0, 0, 1))}
        levels = picture_levels(self.pinchmap, levels, wrap=self.wrap, **lines)
        color = sample_pinchmap(self.pinchmap, levels, st, jacobian, wrap=self.wrap, gradient=gradient, **inputs)
        return color.reshape(view.height, view.width, 4)

    def edge_place(self, rng):
        """A place on the discontinuity, found by halving, in st."""
        while True:
            ends = rng.uniform(0.25, 0.75, (2, 2))
            if np.prod(np.sign(edge(self.pinchmap, ends, self.wrap))) >= 0:
                continue
            for _ in range(60):
                middle = ends.mean(axis=0)
                same = np.sign(edge(self.pinchmap, middle[None], self.wrap)) == np.sign(
                    edge(self.pinchmap, ends[:1], self.wrap)
                )
                ends[0 if same[0] else 1] = middle
            # Not where the discontinuity is switched off: there nothing is sharp.
            at = pinch(self.pinchmap, middle[None], 0.25, wrap=self.wrap)
            if np.abs(at.st - middle).max() > 0.1 / max(SHAPE):
                return middle


def quad_gradient(edges):
    """(N, 2) differences between the pixels of quads, as a GPU takes them, from edge values (H, W), H and W even."""
    height, width = edges.shape
    quads = edges[::-1].reshape(height // 2, 2, width // 2, 2)
    across = np.repeat(np.diff(quads, axis=3), 2, axis=3).reshape(height, width)[::-1]
    up = np.repeat(np.diff(quads, axis=1), 2, axis=1).reshape(height, width)[::-1]
    return np.stack([across.ravel(), up.ravel()], 1)


def render(gl, texture, draw, view, **options):
    """The picture, and whether the shader took derivatives between pixels rather than exact ones."""
    system = TextureSystem(gl, **options)
    picture = render_texture(gl, texture, draw, view, system)
    (slot,) = (slot for _, slot in system._slots.values())
    system.release()
    return picture, slot.codes != 0


@pytest.mark.parametrize("antialias", [0.0, 1.0])
def test_pinchmap_equals_the_twin_at_every_magnification(gl, tmp_path, rng, antialias):
    made = Made(rng, tmp_path)
    texture = made.texture(antialias=antialias)
    flips = pixels = 0
    for exponent in range(7):  # pixels per texel of the pinchmap
        size = (SHAPE[1], SHAPE[0]) if exponent == 0 else (40, 40) if exponent == 1 else (128, 128)
        half = 0.5 * np.array(size) / 10**exponent / np.array(SHAPE[::-1])
        center = made.edge_place(rng) if exponent else np.full(2, 0.5)
        view = front_view(center - half, center + half, *size)
        st, jacobian, _ = pixel_st(view)
        rendered, between_pixels = render(gl, texture, quad(), view)
        edges = edge(made.pinchmap, st).reshape(size[::-1])
        gradient = quad_gradient(edges) if between_pixels else None
        assert between_pixels == (exponent in (1, 2))
        expected = made.expected(view, st, jacobian, gradient, antialias=antialias)
        away = np.abs(edges) > 1e-4
        error = np.abs(rendered - expected).max(axis=-1)
        assert error[away].max(initial=0.0) < (1e-3 if antialias else 1e-4), 10**exponent
        flips += int((error[~away] > 0.2).sum()) if antialias == 0 else 0
        pixels += error.size
    assert flips <= 1e-4 * pixels


@pytest.mark.parametrize("wrap", ["clamp", "repeat", "mirror", "black"])
@pytest.mark.parametrize("zoom", ["near", "deep"])
def test_pinchmap_seam_equals_the_twin(gl, tmp_path, rng, wrap, zoom):
    made = Made(rng, tmp_path, wrap=(wrap, wrap))
    draw = quad((-1.25, -1.25), (2.25, 2.25))
    size = 128
    for corner in (np.array([0.0, 0.0]), np.array([1.0, 0.4]), np.array([0.6, 1.0])):
        place = (corner + 1.25) / 3.5
        half = 0.1 if zoom == "near" else 0.002
        view = front_view(np.maximum(place - half, 0), place + half, size, size)
        in_plane, jacobian, shown = pixel_st(view)
        st = in_plane * 3.5 - 1.25
        edges = edge(made.pinchmap, st, made.wrap).reshape(size, size)
        rendered, between_pixels = render(gl, made.texture(), draw, view)
        gradient = quad_gradient(edges) if between_pixels else None
        expected = made.expected(view, st, jacobian * 3.5, gradient)
        error = np.abs(rendered - expected).max(axis=-1)[shown.reshape(size, size)]
        assert np.quantile(error, 0.999) < 1e-3
        assert (error > 0.05).mean() < 1e-3


@pytest.mark.parametrize("wrap", ["clamp", "repeat", "mirror"])
@pytest.mark.parametrize(
    ("low", "high"), [((1, 1), (2, 2)), ((-1, -1), (0, 0)), ((1.1, 0.1), (1.6, 0.7)), ((3.2, -2.3), (3.7, -2.1))]
)
def test_pinchmap_seen_only_beyond_its_unit_square_equals_the_twin(gl, tmp_path, rng, wrap, low, high):
    made = Made(rng, tmp_path, wrap=(wrap, wrap))
    view = front_view((0, 0), (1, 1), 96, 96)
    in_plane, jacobian, _ = pixel_st(view)
    extent = np.subtract(high, low)
    st, jacobian = in_plane * extent + low, np.diag(extent) @ jacobian
    rendered, between_pixels = render(gl, made.texture(), quad(low, high), view, anisotropy=1)
    gradient = quad_gradient(edge(made.pinchmap, st, made.wrap).reshape(96, 96)) if between_pixels else None
    error = np.abs(rendered - made.expected(view, st, jacobian, gradient)).max(axis=-1)
    assert np.quantile(error, 0.999) < 1e-3
    assert (error > 0.05).mean() < 1e-3


@pytest.mark.parametrize("bits", [8, 16, 32])
@pytest.mark.parametrize("octaves", [0, 3])
def test_pinchmap_of_any_depth_and_signal_size_equals_the_twin(gl, tmp_path, rng, bits, octaves):
    made = Made(rng, tmp_path, octaves, bits=bits, opaque=False)
    view = front_view((0, 0), (1, 1), 512, 384)
    st, jacobian, _ = pixel_st(view)
    gradient = quad_gradient(edge(made.pinchmap, st).reshape(384, 512))
    error = np.abs(render_texture(gl, made.texture(), quad(), view) - made.expected(view, st, jacobian, gradient))
    assert error.max() < 1e-3


@pytest.mark.parametrize("exponent", [1, 3])
def test_pinchmap_line_equals_the_twin(gl, tmp_path, rng, exponent):
    made = Made(rng, tmp_path)
    center = made.edge_place(rng)
    size = 40 if exponent == 1 else 128
    half = 0.5 * size / 10**exponent / np.array(SHAPE[::-1])
    view = front_view(center - half, center + half, size, size)
    st, jacobian, _ = pixel_st(view)
    color = (0.5, 0.25, 1.0, 0.75)
    rendered, between_pixels = render(gl, made.texture(lineWidth=0.05, lineColor=color), quad(), view)
    gradient = quad_gradient(edge(made.pinchmap, st).reshape(size, size)) if between_pixels else None
    expected = made.expected(view, st, jacobian, gradient, line_width=0.05, line_color=color)
    error = np.abs(rendered - expected).max(axis=-1)
    assert np.quantile(error, 0.999) < 2e-3
    assert (error > 0.05).mean() < 1e-3
    plain = made.expected(view, st, jacobian, gradient)
    assert np.abs(plain - expected).max() > 0.2  # there is a line


@pytest.mark.parametrize("pixels", [24, 12, 6, 2, 1])
def test_pinchmap_minified_equals_the_twin(gl, tmp_path, rng, pixels):
    made = Made(rng, tmp_path)
    view = front_view((0, 0), (1, 1), pixels * 4, pixels * 3)
    st, jacobian, _ = pixel_st(view)
    rendered, between_pixels = render(gl, made.texture(), quad(), view, anisotropy=1)
    gradient = None
    if between_pixels and pixels % 2 == 0:
        gradient = quad_gradient(edge(made.pinchmap, st).reshape(view.height, view.width))
    expected = made.expected(view, st, jacobian, gradient)
    assert np.abs(rendered - expected).max() < 1e-3


@pytest.mark.parametrize("shape", [(7, 13), (13, 9)])
@pytest.mark.parametrize("footprint", [0.4, 1.6, 3.1])
def test_pinchmap_of_odd_size_minified_equals_the_twin(gl, tmp_path, rng, shape, footprint):
    made = Made(rng, tmp_path, 2, shape=shape)
    half = 2 * footprint / np.array(shape[::-1])
    view = front_view(np.maximum(0.5 - half, 0.02), np.minimum(0.5 + half, 0.98), 4, 4)
    st, jacobian, _ = pixel_st(view)
    rendered, between_pixels = render(gl, made.texture(), quad(), view, anisotropy=1)
    gradient = quad_gradient(edge(made.pinchmap, st).reshape(4, 4)) if between_pixels else None
    assert np.abs(rendered - made.expected(view, st, jacobian, gradient)).max() < 1e-3


def test_pinchmap_minified_does_not_shimmer(gl, tmp_path, rng):
    made = Made(rng, tmp_path)
    texture, shades = made.texture(), []
    fine = front_view((0, 0), (1, 1), 1024, 768)
    mean = render_texture(gl, texture, quad(), fine)[..., :3].mean((0, 1))
    for shift in np.linspace(0, 0.25, 7):  # a pixel nearly as large as the picture, moved about
        view = front_view((shift, shift), (0.75 + shift, 0.75 + shift), 1, 1)
        shades.append(render_texture(gl, texture, quad(), view)[0, 0, :3])
    assert np.ptp(np.array(shades), axis=0).max() < 0.05
    assert np.abs(np.mean(shades, axis=0) - mean).max() < 0.05


@pytest.mark.parametrize("tilt", [60, 80, 88])
def test_pinchmap_grazing_view_is_near_the_supersampled_picture(gl, tmp_path, rng, tilt):
    made = Made(rng, tmp_path)
    view = tilted_view((0.5, 0.5), 1.2, tilt, 96, 96)
    large = tilted_view((0.5, 0.5), 1.2, tilt, 96 * 8, 96 * 8)
    st, _, shown = pixel_st(large)
    truth = sample_pinchmap(made.pinchmap, made.signal, np.where(shown[:, None], st, 0.5))
    truth[~shown] = 0
    truth = truth.reshape(96, 8, 96, 8, 4).mean((1, 3))
    inside = shown.reshape(96, 8, 96, 8).all((1, 3))
    error = np.abs(render_texture(gl, made.texture(), quad(), view) - truth)[inside]
    assert np.isfinite(error).all()
    assert np.sqrt((error**2).mean()) < 0.04


@pytest.mark.parametrize("exponent", [1, 2, 4, 6])
def test_pinchmap_nested_in_a_zipmap_equals_the_twin(gl, tmp_path, rng, exponent):
    made = Made(rng, tmp_path, opaque=False)
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0.25, 0.5, 0.125, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    turn = np.array([[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]])
    aspect = homography.scale(1, SHAPE[1] / SHAPE[0])
    matrix = homography.translate(-0.5, -0.5) @ turn @ homography.scale(2, 2) @ aspect @ homography.translate(0.5, 0.5)
    define_pinchmap(stage, "/Zipmap/logo", *made.files, matrix=matrix, opacity=0.5)
    center = homography.apply(np.linalg.inv(matrix), made.edge_place(rng)[None])[0]
    half = 32 / 10**exponent / SHAPE[1]
    view = front_view(center - half, center + half, 128, 128) if exponent > 1 else front_view((0, 0), (1, 1), 256, 256)
    st, jacobian, _ = pixel_st(view)
    system = TextureSystem(gl, anisotropy=1)
    rendered = render_texture(gl, zipmap_texture(stage), quad(), view, system, aovs=True)
    own = homography.apply(matrix, st)
    layer = 0.5 * made.expected(view, own, homography.jacobian(matrix, st) @ jacobian)
    to_rim = np.minimum(own, 1 - own).min(axis=1).reshape(view.height, view.width)
    layer *= (to_rim >= 0)[..., None]
    expected = layer + (1 - layer[..., 3:]) * np.array([0.25, 0.5, 0.125, 1])
    error = np.abs(rendered[..., :4] - expected).max(axis=-1)
    away = np.abs(to_rim) > 0.02
    away &= np.abs(edge(made.pinchmap, own).reshape(away.shape)) > 1e-4
    assert error[away].max() < 2e-3
    assert (rendered[..., 5][to_rim > 0.02] == 1).all()  # patchIndex
    system.release()


def test_pinchmap_nested_under_a_projective_matrix_ends_at_its_horizon(gl, tmp_path, rng):
    made = Made(rng, tmp_path)
    base = save(tmp_path / "base.tif", np.full((32, 32, 4), [0, 0.5, 0, 1], np.float32))
    stage = zipmap_stage(Patch(base, np.eye(3), color_space="raw"))
    matrix = np.array([[2.0, 0, 0], [0, 2.0, -1.0], [-0.5, -0.5, 1.4]])
    define_pinchmap(stage, "/Zipmap/logo", *made.files, matrix=matrix)
    view = tilted_view((0.5, 0.5), 1.0, 40, 256, 256)
    st, jacobian, shown = pixel_st(view)
    rendered = render_texture(gl, zipmap_texture(stage), quad(), view)
    own = homography.apply(matrix, st)
    inside = np.isfinite(own).all(1) & shown
    inside[inside] = ((own[inside] > 0.02) & (own[inside] < 0.98)).all(1)
    outside = shown & ~(np.isfinite(own).all(1) & (np.nan_to_num(own, nan=9) > -0.02).all(1))
    expected = sample_pinchmap(
        made.pinchmap, made.signal, own[inside], homography.jacobian(matrix, st[inside]) @ jacobian[inside]
    )
    error = np.abs(rendered.reshape(-1, 4)[inside] - expected).max(axis=1)
    assert np.quantile(error, 0.9) < 0.02
    assert np.abs(rendered.reshape(-1, 4)[outside] - [0, 0.5, 0, 1]).max() < 3e-3


@pytest.mark.parametrize("wrap", ["black", "useMetadata", "clamp", "repeat"])
def test_pinchmap_that_just_fills_a_surface_goes_the_fast_way(gl, tmp_path, rng, wrap):
    made = Made(rng, tmp_path)
    made.wrap = (wrap, wrap)
    for view in (front_view((-0.2, -0.2), (1.2, 1.2), 512, 512), front_view((0.2, 0.2), (0.8, 0.8), 512, 512)):
        assert render(gl, made.texture(), quad(), view)[1]


@pytest.mark.parametrize("matrix", [homography.scale(3, 2), np.array([[1.2, 0.3, 0.1], [-0.2, 0.9, 0.2], [0.1, 0, 1]])])
def test_pinchmap_follows_its_own_matrix(gl, tmp_path, rng, matrix):
    made = Made(rng, tmp_path, wrap=("repeat", "repeat"))
    view = front_view((0.1, 0.1), (0.4, 0.4), 96, 96)
    st, jacobian, _ = pixel_st(view)
    rendered, between_pixels = render(gl, made.texture(matrix=matrix), quad(), view, anisotropy=1)
    place = homography.apply(matrix, st)
    gradient = quad_gradient(edge(made.pinchmap, place, made.wrap).reshape(96, 96)) if between_pixels else None
    expected = made.expected(view, place, homography.jacobian(matrix, st) @ jacobian, gradient)
    assert np.abs(rendered - expected).max() < 2e-3


def test_pinchmap_data_aovs_hold_level_and_layer(gl, tmp_path, rng):
    made = Made(rng, tmp_path)
    for pixels, level in ((64, -1.0), (16, 1.0), (4, 3.0)):
        view = front_view((0, 0), (1, 1), pixels, pixels * 3 // 4)
        rendered = render_texture(gl, made.texture(), quad(), view, aovs=True)
        assert np.abs(rendered[..., 4] - level).max() < 1e-3
        assert (rendered[..., 5] == 0).all()
