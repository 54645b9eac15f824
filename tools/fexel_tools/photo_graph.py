"""The dependency graph of unordered photos: which belong together, which is the root, where each lies in it.

Photos are nodes, accepted pairwise homographies (`fexel_tools.photo_links`) edges. The root, where it is not given,
is the photo whose frame holds most of the others: of the largest connected set of photos the one inside which most of
their outlines lie, the widest of those. Poses come from `fexel_tools.consistency`: chains through intermediate
photos, all links adjusted together, contradicting links dropped. What each photo adds, and under which patch it
hangs, is then decided by `fexel_tools.coverage`. A photo that does not become a patch is rejected with a reason.

Conventions: photos are numbered as given; matrices are 3x3 float64 for column vectors on continuous pixel coordinates
of upright photos.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fexel.errors import FexelError
from fexel_tools.consistency import PoseLink, adjust_poses, apply_homography, chain_poses
from fexel_tools.coverage import MIN_GAIN, Addition, Placement, clip_convex, plan_patches, polygon_area, rectangle

__all__ = ["Link", "PhotoGraph", "build_graph", "choose_root"]

_INSIDE = 0.5  # a photo counts as held by another when this much of its outline lies in it


@dataclass(frozen=True, eq=False)
class Link:
    """An accepted registration of two photos.

    Attributes
    ----------
    coarse, fine : int
        Photo numbers; `fine` has the more pixels on the common part.
    coarse_from_fine : (3, 3) float64
    scale : float
        Pixels of `fine` per pixel of `coarse`.
    score : float
        Of the registration, comparable between links.
    inliers : int
    rms_px : float
        What the homography leaves, pixels of `coarse`.
    sigma_px : float
        Expected error of the homography, pixels of `coarse`.
    """

    coarse: int
    fine: int
    coarse_from_fine: np.ndarray
    scale: float
    score: float
    inliers: int
    rms_px: float
    sigma_px: float


@dataclass(frozen=True, eq=False)
class PhotoGraph:
    """Outcome for all photos.

    Attributes
    ----------
    root : int
    poses : dict of int to (3, 3) float64
        ``root_from_photo`` of every placed photo, also of those that add nothing.
    patches : tuple of Addition
        In draw order; each has a window and a parent.
    rejected : dict of int to str
        Reason per photo that is neither root nor patch.
    links : tuple of Link
        Those in use.
    errors_px : tuple of float
        Per link in use, root mean square misplacement with the final poses, pixels of its coarser photo: what its
        homography leaves, and how far the poses are from that homography.
    dropped : tuple of Link
        Those that contradict the others.
    """

    root: int
    poses: dict[int, np.ndarray]
    patches: tuple[Addition, ...]
    rejected: dict[int, str]
    links: tuple[Link, ...]
    errors_px: tuple[float, ...]
    dropped: tuple[Link, ...]


def build_graph(
    names: list[str],
    sizes: list[tuple[int, int]],
    links: list[Link],
    *,
    root: int | None = None,
    unusable: dict[int, str] | None = None,
    failures: dict[int, tuple[int, str]] | None = None,
    max_error_px: float = np.inf,
    min_gain: float = MIN_GAIN,
) -> PhotoGraph:
    """Place all photos that hang together.

    Parameters
    ----------
    names : list of str
        For reasons.
    sizes : list of (width, height)
        Pixels.
    links : list of Link
    root : int, optional
        Default: chosen.
    unusable : dict of int to str, optional
        Photos that were found unusable before, with reasons; they take no part.
    failures : dict of int to (int, str)
        Per photo the other photo that it came nearest to, and why that is no match; for reasons.
    max_error_px : float
        Greatest root mean square distance of a photo's inliers after adjustment, in pixels of the coarser photo.
    min_gain : float
        See `plan_patches`.

    Raises
    ------
    FexelError
        No photo is usable, or the root asked for is not.
    """
    rejected = dict(unusable or {})
    usable = [k for k in range(len(names)) if k not in rejected]
    if not usable:
        raise FexelError("no usable photo: " + "; ".join(f"{names[k]}: {rejected[k]}" for k in rejected))
    if root is not None and root in rejected:
        raise FexelError(f"{names[root]}: cannot be the root: {rejected[root]}")
    if root is None:
        root = choose_root(usable, sizes, links)
    adjustment = adjust_poses([_pose_link(link) for link in links], sizes, root)
    used = [link for k, link in enumerate(links) if k in adjustment.residual_px]
    errors = [float(np.hypot(links[k].rms_px, px)) for k, px in sorted(adjustment.residual_px.items())]
    dropped = tuple(links[k] for k in adjustment.dropped)
    poses = dict(adjustment.poses)
    _reject_unplaced(names, usable, links, dropped, poses, root, rejected, failures or {})
    _reject_inexact(used, errors, root, max_error_px, rejected)
    placements = [Placement(k, sizes[k], poses[k]) for k in poses if k != root and k not in rejected]
    patches = []
    for addition in plan_patches(Placement(root, sizes[root], poses[root]), placements, min_gain):
        if addition.window is None:
            below = "" if addition.below is None else f" in '{names[addition.below]}'"
            rejected[addition.photo] = addition.reason + below
        else:
            patches.append(addition)
    return PhotoGraph(root, poses, tuple(patches), rejected, tuple(used), tuple(errors), dropped)


def choose_root(usable: list[int], sizes: list[tuple[int, int]], links: list[Link]) -> int:
    """The photo that holds most others, see the module; without any link the photo with the most pixels."""
    best, best_key = usable[0], (-1, -1, -1.0)
    for component in _components(usable, links):
        held = _held_counts(component, sizes, links)
        for photo in component:
            count, extent = held[photo]
            key = (len(component), count, extent if len(component) > 1 else sizes[photo][0] * sizes[photo][1])
            if key > best_key:
                best, best_key = photo, key
    return best


def _pose_link(link: Link) -> PoseLink:
    tolerance = max(3.0, 6.0 * link.sigma_px, 3.0 * link.rms_px)
    return PoseLink(link.coarse, link.fine, link.coarse_from_fine, link.sigma_px, tolerance)


def _components(usable: list[int], links: list[Link]) -> list[list[int]]:
    """Connected sets of photos, each in the order given."""
    group = {k: k for k in usable}

    def find(k: int) -> int:
        while group[k] != k:
            group[k] = group[group[k]]
            k = group[k]
        return k

    for link in links:
        if link.coarse in group and link.fine in group:
            group[find(link.coarse)] = find(link.fine)
    sets: dict[int, list[int]] = {}
    for k in usable:
        sets.setdefault(find(k), []).append(k)
    return list(sets.values())


def _held_counts(component: list[int], sizes: list[tuple[int, int]], links: list[Link]) -> dict[int, tuple[int, float]]:
    """Per photo: how many others lie inside it, and its area in a common frame."""
    base = max(component, key=lambda k: (sum(link.coarse == k for link in links), -k))
    poses = chain_poses([_pose_link(link) for link in links], sizes, base)
    outlines = {k: apply_homography(poses[k], rectangle(0, 0, *sizes[k])) for k in component}
    outlines = {k: o for k, o in outlines.items() if np.isfinite(o).all()}
    area = {k: polygon_area(o) for k, o in outlines.items()}
    held = dict.fromkeys(component, (0, 0.0))
    for k, outline in outlines.items():
        inside = sum(
            other != k and polygon_area(clip_convex(outlines[other], outline)) >= _INSIDE * area[other]
            for other in outlines
        )
        held[k] = (inside, area[k])
    return held


def _reject_unplaced(
    names: list[str],
    usable: list[int],
    links: list[Link],
    dropped: tuple[Link, ...],
    poses: dict[int, np.ndarray],
    root: int,
    rejected: dict[int, str],
    failures: dict[int, tuple[int, str]],
) -> None:
    for k in usable:
        if k in poses or k in rejected:
            continue
        own = [link for link in links if k in (link.coarse, link.fine)]
        contradicted = [link for link in own if link in dropped]
        neighbours = {link.coarse if link.fine == k else link.fine for link in own if link not in dropped}
        if neighbours:
            others = ", ".join(f"'{names[n]}'" for n in sorted(neighbours)[:3])
            rejected[k] = f"matches only {others}, which no chain connects with the root '{names[root]}'"
        elif contradicted:
            link = contradicted[0]
            other = link.coarse if link.fine == k else link.fine
            rejected[k] = f"its match with '{names[other]}' contradicts those of the other photos"
        else:
            near = f" (nearest: '{names[failures[k][0]]}', {failures[k][1]})" if k in failures else ""
            rejected[k] = f"no match with the other photos{near}"


def _reject_inexact(
    links: list[Link], errors_px: list[float], root: int, max_error_px: float, rejected: dict[int, str]
) -> None:
    """Reject photos whose best link stays above the limit."""
    best: dict[int, float] = {}
    for link, error in zip(links, errors_px, strict=True):
        best[link.fine] = min(best.get(link.fine, np.inf), error)
    for photo, error in best.items():
        if photo != root and error > max_error_px:
            rejected[photo] = f"residual of {error:.2f} px is over the limit of {max_error_px:g} px (--max-error)"
