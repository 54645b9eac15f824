"""Pinchmaps in float64 NumPy: the oracle of shaders/pinchmap_warp.glsl, and lookups without a GPU.

The program of sections 4 to 6 of Tarini and Cignoni 2005 ("Pinchmaps: textures with customizable discontinuities"),
with its open points settled as `fexel.textures.pinchmap_segment` says. The pinchmap is fetched at st + 0.5 / size
whatever the size of the signal, so that its texel lies at the lower left corner of its cell. Edges are as wide as asked
in pixels, measured across the line by the gradient of k^B - gamma^B. Where a pixel covers whole cells, the displacement
fades and the mip levels show averages.

Conventions: images are (H, W, C), row 0 at the top; a pinchmap is (Nh, Nw, 4): d_s, d_t, k, gamma in [-1, 1]. s runs
right, t runs up. M is a number of points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fexel import mipmaps
from fexel.errors import FexelError
from fexel.textures.pinchmap_encoding import signal_half_texel
from fexel.textures.pinchmap_lattice import Lattice, blocks, trilinear
from fexel.textures.pinchmap_segment import Segment

__all__ = [
    "Pinch",
    "cell_samples",
    "edge",
    "picture_image",
    "picture_levels",
    "pinch",
    "sample_pinchmap",
]

# Along a cell, for its average: as many as keep a picture within half a second, but for huge ones. RMS of level 1, of
# white noise in [0, 1], against 8: 0.002 with 4, 0.006 with 2 (0.03 with 1).
_SAMPLES = (8, 4, 2)
_MOST_SAMPLES = 1 << 20
_POINTS = 1 << 17  # averaged at once, for memory
_FLOOR = 1e-30  # keeps logarithms finite where the jacobian is 0


@dataclass(frozen=True)
class Pinch:
    """Where points are looked up in the signal.

    Attributes
    ----------
    st : (M, 2) float64
        Displaced coordinates.
    k_b, gamma_b : (M,) float64
        Interpolated k and gamma; a point is on the side of k = +1 where ``k_b > gamma_b``.
    line : (M,) float64
        Coverage of the solid line, 0 to 1.
    """

    st: NDArray[np.float64]
    k_b: NDArray[np.float64]
    gamma_b: NDArray[np.float64]
    line: NDArray[np.float64]


def edge(
    pinchmap: NDArray[np.floating], st: NDArray[np.floating], wrap: tuple[str, str] = ("clamp", "clamp")
) -> NDArray[np.float64]:
    """k^B - gamma^B: the discontinuity is where it changes sign.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4)
    st : (M, 2)
    wrap : (str, str)
        ``repeat``, ``mirror``; all else clamps.

    Returns
    -------
    (M,) float64
        Positive on the side of k = +1.
    """
    lattice = Lattice(pinchmap[..., 2:3] - pinchmap[..., 3:4], wrap)
    st = np.asarray(st, np.float64)
    result = np.empty(len(st))
    for block in blocks(len(st)):
        cell, fraction, _ = lattice.locate(st[block])
        result[block] = lattice.interpolate(cell, fraction)[:, 0]
    return result


def pinch(
    pinchmap: NDArray[np.floating],
    st: NDArray[np.floating],
    h: float,
    *,
    wrap: tuple[str, str] = ("clamp", "clamp"),
    jacobian: NDArray[np.floating] | None = None,
    antialias: float = 0.0,
    line_width: float = 0.0,
    gradient: NDArray[np.floating] | None = None,
) -> Pinch:
    """Displace texture coordinates so that undesired fexels are not seen (sections 4 to 6).

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4)
    st : (M, 2)
    h : float
        Half a signal texel, in pinchmap texels: 2^(-K-1).
    wrap : (str, str)
        ``repeat``, ``mirror``; all else clamps.
    jacobian : (2, 2) or (M, 2, 2), optional
        d(st)/d(pixel), column j per pixel along x, y. Default: a pixel is a point.
    antialias : float
        Width of the transition in pixels; 0 is a hard edge.
    line_width : float
        Of the solid line, in pinchmap texels.
    gradient : (M, 2), optional
        d(k^B - gamma^B)/d(pixel) where it is not the exact one: what a GPU gets from differences between pixels.

    Returns
    -------
    Pinch
    """
    lattice = Lattice(np.asarray(pinchmap, np.float64), wrap)
    axes = np.zeros((2, 2)) if jacobian is None else np.asarray(jacobian, np.float64)
    return _pinched(lattice, np.asarray(st, np.float64), h, axes, antialias, line_width, gradient)


def _pinched(
    lattice: Lattice,
    st: NDArray[np.float64],
    h: float,
    jacobian: NDArray[np.float64],
    antialias: float,
    line_width: float,
    gradient: NDArray[np.floating] | None = None,
) -> Pinch:
    """`pinch`."""
    size = lattice.size
    axes = jacobian * size[:, None]
    footprint = np.broadcast_to(_major_axis(axes), len(st))
    axes = np.broadcast_to(axes, (len(st), 2, 2))
    result = Pinch(st.copy(), np.empty(len(st)), np.empty(len(st)), np.zeros(len(st)))
    for block in blocks(len(st)):
        cell, fraction, direction = lattice.locate(st[block])
        texel = lattice.interpolate(cell, fraction)
        result.k_b[block], result.gamma_b[block] = texel[:, 2], texel[:, 3]
        active = np.flatnonzero(lattice.is_active(cell))
        if not len(active):
            continue
        where = block.start + active
        slope = lattice.edge_slope(cell[active], fraction[active]) * direction[active]
        if gradient is None:
            across = np.einsum("mi,mij->mj", slope, axes[where])
        else:
            across = gradient[where]
            slope = _texel_gradient(across, axes[where])
        width = antialias * np.hypot(across[:, 0], across[:, 1])
        part = Segment(texel[active], fraction[active])
        offset = part.displacement(h, width, footprint[where])
        result.st[where] += offset * direction[active] / size
        if line_width > 0:
            half = 0.5 * line_width * np.hypot(slope[:, 0], slope[:, 1])
            result.line[where] = part.line_coverage(half, width, footprint[where])
    return result


def sample_pinchmap(
    pinchmap: NDArray[np.floating],
    signal: Sequence[NDArray[np.floating]] | NDArray[np.floating],
    st: NDArray[np.floating],
    jacobian: NDArray[np.floating] | None = None,
    *,
    antialias: float = 1.0,
    line_width: float = 0.0,
    line_color: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    wrap: tuple[str, str] = ("clamp", "clamp"),
    gradient: NDArray[np.floating] | None = None,
) -> NDArray[np.float64]:
    """Look up a pinchmapped texture.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4)
    signal : (2^K Nh, 2^K Nw, 4), or its mip levels, finest first
        Linear, premultiplied. A single image is filtered here; give levels to do so once.
    st : (M, 2)
    jacobian : (2, 2) or (M, 2, 2), optional
        d(st)/d(pixel), column j per pixel along x, y. Default: a pixel is a point, so edges are hard.
    antialias : float
        Width of the transition in pixels; 0 is a hard edge.
    line_width : float
        Of the solid line along discontinuities, in pinchmap texels; 0 for none.
    line_color : (4,)
        Linear, straight alpha.
    wrap : (str, str)
        ``repeat``, ``mirror``, ``black`` (transparent outside [0, 1]^2), else clamp.
    gradient : (M, 2), optional
        As for `pinch`.

    Returns
    -------
    (M, 4) float64
        Linear, premultiplied. Zero where `st` or `jacobian` is not finite.

    Raises
    ------
    FexelError
        The sizes of pinchmap and signal do not go together.
    """
    levels = [signal, *mipmaps.pyramid(signal)[1:]] if isinstance(signal, np.ndarray) else list(signal)
    size = (pinchmap.shape[1], pinchmap.shape[0])
    signal_size = (levels[0].shape[1], levels[0].shape[0])
    h = signal_half_texel(size, signal_size)
    if h is None:
        raise FexelError(
            f"a signal of {signal_size[0]} x {signal_size[1]} texels with a pinchmap of {size[0]} x {size[1]}: "
            "expected the pinchmap's size times 1, 2, 4 or another power of two"
        )
    axes = np.zeros((2, 2)) if jacobian is None else np.asarray(jacobian, np.float64)
    st, axes, finite = _finite(np.asarray(st, np.float64), axes)
    lattice = Lattice(np.asarray(pinchmap, np.float64), wrap)
    place = _pinched(lattice, st, h, axes, antialias, line_width, gradient)
    color = _colored(place, levels, axes, line_width, line_color, wrap)
    return np.where(finite[:, None], color, 0.0)


def _colored(
    place: Pinch,
    levels: Sequence[NDArray[np.floating]],
    axes: NDArray[np.float64],
    line_width: float,
    line_color: Sequence[float],
    wrap: tuple[str, str],
) -> NDArray[np.float64]:
    """(M, 4): the signal at displaced points, under the line."""
    footprint = _major_axis(axes * np.array(levels[0].shape[1::-1])[:, None])
    lod = np.broadcast_to(np.log2(np.maximum(footprint, _FLOOR)), len(place.st))
    color = trilinear(levels, place.st, lod, wrap)
    if line_width <= 0:
        return color
    ink = np.array([*np.multiply(line_color[:3], line_color[3]), line_color[3]])
    cover = place.line[:, None]
    return cover * ink + (1 - cover * line_color[3]) * color


def cell_samples(pinchmap: NDArray[np.floating], wrap: tuple[str, str]) -> int:
    """Samples of `picture_levels` along a cell, a power of two: fewer where many cells are to be averaged."""
    return _samples(int(Lattice(pinchmap, wrap).active_cells().sum()))


def _samples(cells: int) -> int:
    return next((n for n in _SAMPLES if n * n * cells <= _MOST_SAMPLES), _SAMPLES[-1])


def picture_levels(
    pinchmap: NDArray[np.floating],
    levels: Sequence[NDArray[np.floating]],
    *,
    line_width: float = 0.0,
    line_color: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    wrap: tuple[str, str] = ("clamp", "clamp"),
) -> list[NDArray[np.float32]]:
    """Mip levels to look a pinchmapped texture up in, without shimmer however small it is seen.

    Those as coarse as the mask or finer are the signal's. Coarser ones, of which no discontinuity is left to pinch, are
    averages of the picture: the signal's own would be those of the picture before pinching, and without its lines.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4)
    levels : sequence of (H, W, 4)
        Mip levels of the signal, linear, premultiplied, finest first.
    line_width, line_color, wrap
        As for `sample_pinchmap`.

    Returns
    -------
    list of (H, W, 4) float32
    """
    height, width = pinchmap.shape[:2]
    same = next(number for number, level in enumerate(levels) if level.shape[:2] == (height, width))
    picture = np.array(levels[same], np.float32)
    _average(picture, pinchmap, levels, _Ink(line_width, line_color), wrap)
    return [*(np.asarray(level, np.float32) for level in levels[: same + 1]), *mipmaps.pyramid(picture)[1:]]


def picture_image(
    pinchmap: NDArray[np.floating],
    signal: NDArray[np.floating],
    *,
    line_width: float = 0.0,
    line_color: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    wrap: tuple[str, str] = ("clamp", "clamp"),
) -> NDArray[np.float32]:
    """A pinchmapped texture as a plain image, as fine as its signal: what prefiltered images are made from.

    Parameters
    ----------
    pinchmap : (Nh, Nw, 4)
    signal : (2^K Nh, 2^K Nw, 4)
        Linear, premultiplied.
    line_width, line_color, wrap
        As for `sample_pinchmap`.

    Returns
    -------
    (2^K Nh, 2^K Nw, 4) float32
        The signal where nothing is pinched, else averages of the picture over each texel.
    """
    picture = np.array(signal, np.float32)
    _average(picture, pinchmap, [signal], _Ink(line_width, line_color), wrap)
    return picture


@dataclass(frozen=True)
class _Ink:
    """The line along discontinuities."""

    width: float
    color: Sequence[float]


def _average(
    picture: NDArray[np.float32],
    pinchmap: NDArray[np.floating],
    levels: Sequence[NDArray[np.floating]],
    ink: _Ink,
    wrap: tuple[str, str],
) -> None:
    """Replace the texels of cells where something is pinched by averages; `picture` is 2^K as fine as the pinchmap."""
    height, width = pinchmap.shape[:2]
    per_cell = picture.shape[1] // width
    lattice = Lattice(np.asarray(pinchmap, np.float64), wrap)
    row, column = np.nonzero(lattice.active_cells())
    samples = max(_samples(len(row)), 2 * per_cell if per_cell > 1 else 1)
    inside = (np.arange(samples) + 0.5) / samples
    places = np.stack(np.meshgrid(inside, inside), -1).reshape(-1, 2)
    corners = np.stack([column, height - 1 - row], 1)
    axes = np.diag([1 / (width * samples), 1 / (height * samples)])
    half_texel = 0.5 * width / levels[0].shape[1]
    texels = picture.reshape(height, per_cell, width, per_cell, 4).swapaxes(1, 2)
    for block in blocks(len(row), max(1, _POINTS // samples**2)):
        st = (corners[block, None, :] + places).reshape(-1, 2) / (width, height)
        place = _pinched(lattice, st, half_texel, axes, 1.0, ink.width)
        color = _colored(place, levels, axes, ink.width, ink.color, wrap)
        each = color.reshape(-1, per_cell, samples // per_cell, per_cell, samples // per_cell, 4)
        texels[row[block], column[block]] = each.mean(axis=(2, 4))[:, ::-1]


def _major_axis(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Longest axis of the ellipse that (..., 2, 2) makes of a unit circle."""
    a, b = np.sum(axes[..., 0] ** 2, -1), np.sum(axes[..., 1] ** 2, -1)
    c = np.sum(axes[..., 0] * axes[..., 1], -1)
    return np.sqrt(0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + c * c))


def _texel_gradient(across: NDArray[np.float64], axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gradient per texel from that per pixel: the transposed inverse of `axes`, 0 where there is none."""
    determinant = axes[:, 0, 0] * axes[:, 1, 1] - axes[:, 0, 1] * axes[:, 1, 0]
    inverse = np.divide(1.0, determinant, out=np.zeros_like(determinant), where=determinant != 0)
    s = axes[:, 1, 1] * across[:, 0] - axes[:, 1, 0] * across[:, 1]
    t = axes[:, 0, 0] * across[:, 1] - axes[:, 0, 1] * across[:, 0]
    return np.stack([s, t], 1) * inverse[:, None]


def _finite(
    st: NDArray[np.float64], axes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Places and Jacobians with zeros where either is not finite, and where both are."""
    known = np.isfinite(axes).all((-2, -1))
    finite = np.isfinite(st).all(1) & known
    if finite.all():
        return st, axes, finite
    return np.where(finite[:, None], st, 0.0), np.where(known[..., None, None], axes, 0.0), finite
