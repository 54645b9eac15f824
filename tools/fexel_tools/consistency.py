"""Global consistency: one homography per photo that agrees best with all pairwise ones.

A chain of pairwise homographies adds up their errors, and where links close a loop they contradict one another. All
poses ``root_from_photo`` are therefore adjusted together: over a grid of points in the overlap of each link, the
position that the poses predict is compared with the position that the link states, in pixels of the link's coarser
photo, and the sum of squares (weighted by what the link is known to, with a Geman-McClure weight per link) is
minimised by Gauss-Newton. Each pose moves by ``exp(A)``, A in sl(3): eight numbers, in coordinates of its own photo
scaled to unit size, so that a photo magnified a million times is as well conditioned as the root. A link that still
disagrees is dropped, the worst first, and named.

Conventions: 3x3 float64 for column vectors on continuous pixel coordinates; the root's pose is the identity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

__all__ = ["Adjustment", "PoseLink", "adjust_poses", "apply_homography", "chain_poses", "sample_overlap"]

_ITERATIONS = 30
_STEP_TOLERANCE = 1e-6  # of half a photo: hundredths of a pixel that nothing could measure
_SIGMA_FLOOR_PX = 0.05  # no link is trusted further than photometric refinement reaches
_SCALE_SIGMAS = 3.0  # Geman-McClure scale: a link this many sigmas off counts a quarter
_CANDIDATES = 12  # links tried per contradiction
_TRUST = 0.2  # what the loss of the most trusted link costs, in links left unreconciled
_OUTLIER_PX = 3.0  # a link this far from all others is an error, not noise


@dataclass(frozen=True)
class PoseLink:
    """One measured homography between two photos.

    Attributes
    ----------
    coarse, fine : int
        Photo numbers.
    coarse_from_fine : (3, 3) float64
        Pixels of `fine` to pixels of `coarse`.
    sigma_px : float
        Expected error in pixels of `coarse`.
    tolerance_px : float
        Disagreement beyond which the link is dropped, pixels of `coarse` (lens distortion and depth make honest links
        differ).
    """

    coarse: int
    fine: int
    coarse_from_fine: np.ndarray
    sigma_px: float = 0.3
    tolerance_px: float = _OUTLIER_PX


@dataclass(frozen=True)
class Adjustment:
    """Result of `adjust_poses`.

    Attributes
    ----------
    poses : dict of int to (3, 3) float64
        ``root_from_photo`` of every photo that hangs together with the root; m22 = 1 at the photo's centre.
    residual_px : dict of int to float
        Per link number, root mean square disagreement in pixels of its coarser photo.
    dropped : tuple of int
        Link numbers left out because they contradict the others.
    """

    poses: dict[int, np.ndarray]
    residual_px: dict[int, float]
    dropped: tuple[int, ...]


def apply_homography(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Map (N, 2) points by a column-vector homography; NaN where w <= 0 (at or behind infinity)."""
    points = np.asarray(points, np.float64)
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    w = homogeneous[:, 2:]
    return np.where(w > 0.0, homogeneous[:, :2] / np.where(w > 0.0, w, 1.0), np.nan)


def sample_overlap(
    matrix: np.ndarray, fine_size: tuple[int, int], coarse_size: tuple[int, int], count: int = 7
) -> np.ndarray:
    """Points of the finer photo, on a regular grid, that lie in the coarser photo: (N, 2) float64 pixels of `fine`."""
    for n in (count, 4 * count, 16 * count):
        axis = (np.arange(n) + 0.5) / n
        grid = np.stack(np.meshgrid(axis * fine_size[0], axis * fine_size[1]), axis=-1).reshape(-1, 2)
        target = apply_homography(matrix, grid)
        with np.errstate(invalid="ignore"):
            inside = ((target >= 0.0) & (target <= np.asarray(coarse_size, np.float64))).all(axis=1)
        if np.count_nonzero(inside) >= 8:  # eight unknowns per pose ask for four points at least
            return grid[inside]
    return grid[inside]


def chain_poses(links: list[PoseLink], sizes: list[tuple[int, int]], root: int) -> dict[int, np.ndarray]:
    """Poses along the spanning tree of the most certain links; photos without a chain to the root are missing."""
    poses = {root: np.eye(3)}
    open_links = sorted(links, key=lambda link: link.sigma_px)
    while True:
        for link in open_links:
            if (link.coarse in poses) != (link.fine in poses):
                break
        else:
            return poses
        if link.coarse in poses:
            new, pose = link.fine, poses[link.coarse] @ link.coarse_from_fine
        else:
            new, pose = link.coarse, poses[link.fine] @ np.linalg.inv(link.coarse_from_fine)
        poses[new] = _unit_w(pose, sizes[new])


def adjust_poses(links: list[PoseLink], sizes: list[tuple[int, int]], root: int) -> Adjustment:
    """Adjust the poses of all photos that links connect with the root.

    Parameters
    ----------
    links : list of PoseLink
    sizes : list of (width, height)
        Pixels, by photo number.
    root : int
        Its pose stays the identity.

    Returns
    -------
    Adjustment
        With a tree of links (no loop) the poses are the chained ones and all residuals vanish.
    """
    dropped: list[int] = []
    poses, residual = _solve(links, sizes, root, dropped)
    while True:
        excess = {k: residual[k] / links[k].tolerance_px for k in residual}
        worst = max(excess, key=excess.__getitem__, default=None)
        if worst is None or excess[worst] <= 1.0:
            return Adjustment(poses, residual, tuple(sorted(dropped)))
        poses, residual, out = _without_one(links, sizes, root, dropped, excess, worst)
        dropped.append(out)


_Solution = tuple[dict[int, np.ndarray], dict[int, float]]


def _solve(links: list[PoseLink], sizes: list[tuple[int, int]], root: int, dropped: list[int]) -> _Solution:
    """Poses without the dropped links, and the residual of every link used."""
    kept = [k for k in range(len(links)) if k not in dropped]
    poses = chain_poses([links[k] for k in kept], sizes, root)
    used = [k for k in kept if links[k].coarse in poses and links[k].fine in poses]
    samples = {k: _link_samples(links[k], sizes) for k in used}
    poses = _gauss_newton(poses, {k: links[k] for k in used}, samples, sizes, root)
    return poses, {k: _rms(_link_residual(links[k], poses, samples[k])) for k in used}


def _without_one(
    links: list[PoseLink],
    sizes: list[tuple[int, int]],
    root: int,
    dropped: list[int],
    excess: dict[int, float],
    worst: int,
) -> tuple[dict[int, np.ndarray], dict[int, float], int]:
    """Leave out the one link whose absence reconciles most of the others: the worst itself or one beside it.

    A wrong link can be the cause of a neighbour's disagreement, so each is tried.
    """
    ends = {links[worst].coarse, links[worst].fine}
    near = sorted((k for k in excess if {links[k].coarse, links[k].fine} & ends), key=lambda k: -excess[k])
    trust = {k: 1.0 / (max(links[k].sigma_px, _SIGMA_FLOOR_PX) * _zoom(links[k], sizes)) for k in near}
    best: tuple[float, tuple[dict[int, np.ndarray], dict[int, float], int]] | None = None
    for k in near[:_CANDIDATES]:
        poses, residual = _solve(links, sizes, root, [*dropped, k])
        cost = sum(min(1.0, residual[i] / links[i].tolerance_px) ** 2 for i in residual)
        cost += len(excess) - 1 - len(residual)  # links cut off with their photo are lost, not reconciled
        cost += _TRUST * trust[k] / max(trust.values())  # decides a triangle, which any of its three links reconciles
        if best is None or cost < best[0]:
            best = cost, (poses, residual, k)
    assert best is not None
    return best[1]


def _zoom(link: PoseLink, sizes: list[tuple[int, int]]) -> float:
    """Pixels of the finer photo per pixel of the coarser, at the finer one's centre."""
    matrix = _unit_w(link.coarse_from_fine, sizes[link.fine])
    return float(max(abs(np.linalg.det(matrix)), 1e-24) ** -0.5)  # 1e-24: a collapsed footprint


def _unit_w(pose: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Scale to w = 1 at the photo's centre; m22 = 1 could leave w < 0 inside."""
    return pose / (pose[2] @ np.array([size[0] / 2.0, size[1] / 2.0, 1.0]))


def _link_samples(link: PoseLink, sizes: list[tuple[int, int]]) -> np.ndarray:
    return sample_overlap(link.coarse_from_fine, sizes[link.fine], sizes[link.coarse])


def _link_residual(link: PoseLink, poses: dict[int, np.ndarray], points: np.ndarray) -> np.ndarray:
    """(N, 2) predicted minus stated position, pixels of the coarser photo; NaN for predictions behind infinity."""
    predicted = _unit_at(np.linalg.solve(poses[link.coarse], poses[link.fine]), points)
    return apply_homography(predicted, points) - apply_homography(link.coarse_from_fine, points)


def _unit_at(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    w = points @ matrix[2, :2] + matrix[2, 2]
    return matrix / w[np.argmax(np.abs(w))] if len(w) else matrix


def _rms(residual: np.ndarray) -> float:
    if not len(residual) or not np.isfinite(residual).all():
        return float("inf")
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def _gauss_newton(
    poses: dict[int, np.ndarray],
    links: dict[int, PoseLink],
    samples: dict[int, np.ndarray],
    sizes: list[tuple[int, int]],
    root: int,
) -> dict[int, np.ndarray]:
    free = [photo for photo in poses if photo != root]
    if len(links) <= len(free):  # a tree: the chain is the solution
        return poses
    column = {photo: 8 * k for k, photo in enumerate(free)}
    frames = {photo: _unit_frame(sizes[photo]) for photo in poses}
    scale = np.inf
    for _ in range(_ITERATIONS):
        residuals = {key: _link_residual(link, poses, samples[key]) for key, link in links.items()}
        # Graduated non-convexity: all links count at first; the scale falls until those that contradict have lost their
        # say.
        sigmas = [_rms(residual) / links[key].sigma_px for key, residual in residuals.items()]
        scale = max(_SCALE_SIGMAS, 0.5 * min(scale, max((s for s in sigmas if np.isfinite(s)), default=0.0)))
        weights = {key: _link_weight(link, residuals[key], scale) for key, link in links.items()}
        blocks, right = [], []
        for row, (key, link) in enumerate(links.items()):
            if weights[key] > 0.0:
                derivatives = _link_jacobian(link, poses, frames, samples[key])
                blocks += [(row, column[p], weights[key] * d) for p, d in derivatives.items() if p in column]
                right.append((row, -weights[key] * residuals[key].ravel()))
        step = _solve_step(blocks, right, 8 * len(free))
        for photo in free:
            move = _exp_sl3(step[column[photo] : column[photo] + 8])
            frame = frames[photo]
            poses[photo] = _unit_w(poses[photo] @ np.linalg.inv(frame) @ move @ frame, sizes[photo])
        if scale == _SCALE_SIGMAS and np.abs(step).max() < _STEP_TOLERANCE:
            break
    return poses


def _solve_step(
    blocks: list[tuple[int, int, np.ndarray]], right: list[tuple[int, np.ndarray]], unknowns: int
) -> np.ndarray:
    """Least squares step from the normal equations, summed link by link: each link touches 16 unknowns only."""
    right_of = dict(right)
    by_row: dict[int, list[tuple[int, np.ndarray]]] = {}
    for row, start, block in blocks:
        by_row.setdefault(row, []).append((start, block))
    gradient = np.zeros(unknowns)
    rows, columns, values = [], [], []
    for row, parts in by_row.items():
        for start, block in parts:
            gradient[start : start + 8] += block.T @ right_of[row]
            for other, other_block in parts:
                i, j = np.meshgrid(np.arange(start, start + 8), np.arange(other, other + 8), indexing="ij")
                rows.append(i.ravel())
                columns.append(j.ravel())
                values.append((block.T @ other_block).ravel())
    normal = scipy.sparse.coo_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(unknowns, unknowns)
    ).tocsc()
    # The tiny ridge (of a unit-sized photo) guards directions that no link fixes: a sliver of overlap.
    return scipy.sparse.linalg.spsolve(normal + 1e-9 * scipy.sparse.eye(unknowns, format="csc"), gradient)


def _link_weight(link: PoseLink, residual: np.ndarray, scale: float) -> float:
    """Square root of the weight of one point of a link: 1/sigma, less for a link that disagrees (Geman-McClure)."""
    rms = _rms(residual)
    if not np.isfinite(rms):
        return 0.0
    sigma = max(link.sigma_px, _SIGMA_FLOOR_PX)
    robust = 1.0 / (1.0 + (rms / (scale * sigma)) ** 2)
    return robust / (sigma * np.sqrt(len(residual)))


def _unit_frame(size: tuple[int, int]) -> np.ndarray:
    """Pixels to coordinates with the photo's centre at 0 and its half diagonal 1."""
    half = np.hypot(*size) / 2.0
    return np.array([[1.0 / half, 0.0, -size[0] / 2.0 / half], [0.0, 1.0 / half, -size[1] / 2.0 / half], [0, 0, 1.0]])


def _generators(points: np.ndarray) -> np.ndarray:
    """(N, 2, 8): displacement of points by each generator of sl(3), first order."""
    x, y = points[:, 0], points[:, 1]
    one, zero = np.ones_like(x), np.zeros_like(x)
    in_x = np.stack([one, zero, x, -y, x, y, x * x, x * y], axis=1)
    in_y = np.stack([zero, one, y, x, -y, x, x * y, y * y], axis=1)
    return np.stack([in_x, in_y], axis=1)


def _exp_sl3(a: np.ndarray) -> np.ndarray:
    """Homography whose first-order displacement is ``_generators @ a``."""
    generator = np.array(
        [
            [a[2] + a[4], -a[3] + a[5], a[0]],
            [a[3] + a[5], a[2] - a[4], a[1]],
            [-a[6], -a[7], 0.0],
        ]
    )
    term = total = np.eye(3)
    for k in range(1, 13):  # steps stay under 1 in unit coordinates: 1/13! is below rounding
        term = term @ generator / k
        total = total + term
    return total


def _jacobian_at(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N, 2, 2): derivative of the mapped point with respect to the point."""
    homogeneous = points @ matrix[:, :2].T + matrix[:, 2]
    w = homogeneous[:, 2][:, None, None]
    mapped = homogeneous[:, :2] / homogeneous[:, 2:]
    return (matrix[None, :2, :2] - mapped[:, :, None] * matrix[None, 2:, :2]) / w


def _link_jacobian(
    link: PoseLink, poses: dict[int, np.ndarray], frames: dict[int, np.ndarray], points: np.ndarray
) -> dict[int, np.ndarray]:
    """Derivative of the residual with respect to the moves of both poses: (2N, 8) each."""
    predicted = _unit_at(np.linalg.solve(poses[link.coarse], poses[link.fine]), points)
    fine, coarse = frames[link.fine], frames[link.coarse]
    local = apply_homography(fine, points)
    by_fine = _jacobian_at(predicted, points) @ _generators(local) / fine[0, 0]
    target = apply_homography(coarse, apply_homography(predicted, points))
    by_coarse = -_generators(target) / coarse[0, 0]
    return {link.fine: by_fine.reshape(-1, 8), link.coarse: by_coarse.reshape(-1, 8)}
