"""Registration of two photos of one surface at very different zoom.

Features propose, photometry decides: every descriptor match between the photo's coarse features and the parent's votes
for a placement (`fexel_tools.matching`), placements are aligned and ranked by how the photos correlate there
(`fexel_tools.placement_search`), the best are refined to sub-pixel (`fexel_tools.refinement`), and one is accepted when
the photos agree down to the finest detail that the parent shows (`fexel_tools.verification`). Source of the task:
Eisemann and Magnor, "Zipmaps: zoom-into-parts texture maps", VMV 2010, section 4, who match SIFT features and
fit a homography, up to a scale of about 12.

An expected failure, such as photos of different things, is a `Registration` that is not accepted and says why.

Conventions: continuous pixel coordinates, x right, y down, (0, 0) the outer corner of the first pixel; matrices map
the photo to the parent, column vectors. Nothing is random and no global state is touched: the same photos give the same
result.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fexel.errors import FexelError
from fexel_tools.alignment import map_points
from fexel_tools.features import MAX_SIDE, Features, detect_features, pyramid_only
from fexel_tools.matching import Matches, coverage, fit_homography, guided_matches, match_features, similarities
from fexel_tools.placement_search import search_placements
from fexel_tools.refinement import footprint_columns, measure_placement, refine_placement
from fexel_tools.verification import Evidence

__all__ = ["Registration", "refine", "register_features", "register_pair"]

MAX_ERROR_PX = 3.0
_MIN_DETAIL = 0.8
_MIN_AGREEING = 0.8
_MAX_RESIDUAL = 0.4  # working pixels; right placements leave 0.05 to 0.25, those in a regular pattern 0.5 and more
_INLIER_PX = 2.5  # working pixels of the parent
_MIN_INLIERS = 24  # chance placements and repeated windows gather less than ten
_MIN_COVERAGE = 0.08
_MIN_LIKENESS = 0.6  # correlation that features alone must be supported by
_TRIED = 2  # candidate placements refined to the end before giving up
_RIVAL_CORRELATION = 0.06  # coarse placements this close to the best might be as good once refined
_RIVAL_DETAIL = 0.05  # and are, when their detail correlates about as well
_MIN_CORRELATION = 0.5  # below it a coarse placement is not worth refining
_CROP_MARGIN = 0.15  # of the footprint, kept around it for `refine`
_CROP_SIDE = 1024  # working size of the crop, pixels


@dataclass(frozen=True, eq=False)
class Registration:
    """Outcome of registering a photo with a parent.

    Attributes
    ----------
    accepted : bool
    matrix : (3, 3) float64 or None
        Photo to parent, continuous pixel coordinates, column vectors, ``m22`` scaled so that w = 1 at the photo's
        centre. None when not accepted.
    score : float
        Correlation of the detail that both photos show, in [-1, 1]; comparable between pairs.
    reason : str
        Empty when accepted, else one sentence.
    scale : float
        Photo pixels per parent pixel at the photo's centre; 0 when nothing was found.
    inliers : int
        Feature matches that agree with the matrix. May be few or none at large zoom, where photometry decides.
    rms_px : float
        Root mean square misplacement that the homography leaves, over textured blocks of the footprint, in pixels of
        the parent; lens distortion and relief show here. `inf` when nothing was found.
    sigma_px : float
        Expected error of the matrix itself at the photo's corners, parent pixels; `inf` when nothing was found.
    correlation : float
        Of luminance over the whole footprint, in [-1, 1].
    by_features : bool
        Features decided and not the detail, as where water moves or a scene has depth; `rms_px` is then the inliers'.
    points : (N, 4) float64
        The inliers: x, y in the photo, x, y in the parent.
    """

    accepted: bool
    matrix: np.ndarray | None
    score: float
    reason: str
    scale: float = 0.0
    inliers: int = 0
    rms_px: float = np.inf
    sigma_px: float = np.inf
    correlation: float = -1.0
    by_features: bool = False
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))


def register_pair(
    parent: np.ndarray,
    photo: np.ndarray,
    *,
    max_error_px: float = MAX_ERROR_PX,
    max_side: int = MAX_SIDE,
    seed: int = 0,
) -> Registration:
    """Find where a photo lies in a parent that shows the same surface from farther off.

    Parameters
    ----------
    parent, photo : (H, W), (H, W, 3) or (H, W, 4) array
        uint8 or uint16, sRGB-encoded; or float, linear light of any exposure (negative and non-finite values count as
        black). Alpha is ignored. Any size: the work is done on bounded pyramids.
    max_error_px : float
        Accept a residual (see `Registration.rms_px`) up to this, parent pixels.
    max_side : int
        Longest side of the working images, pixels.
    seed : int
        Kept for callers that pass one everywhere: the method draws no random numbers.

    Returns
    -------
    Registration

    Raises
    ------
    FexelError
        An input is not an image.

    Examples
    --------
    >>> grey = np.full((64, 64), 128, np.uint8)
    >>> register_pair(grey, grey).reason
    'the parent shows nothing to register by'
    """
    del seed
    parent_features = detect_features(parent, max_side=max_side)
    photo_features = detect_features(photo, max_side=max_side)
    found = register_features(parent_features, photo_features, max_error_px=max_error_px)
    if found.accepted and parent_features.reduction.max() > 1.01:
        refined = refine(parent, photo, found.matrix, max_error_px=max_error_px)
        if refined.accepted:
            return replace(refined, inliers=found.inliers, points=found.points)
    return found


def register_features(parent: Features, photo: Features, *, max_error_px: float = MAX_ERROR_PX) -> Registration:
    """As `register_pair`, for photos analysed before (`fexel_tools.features.detect_features`).

    Parameters
    ----------
    parent, photo : Features
    max_error_px : float

    Returns
    -------
    Registration
    """
    for features, name in ((parent, "parent"), (photo, "photo")):
        if not len(features.points):
            return _rejected(f"the {name} shows nothing to register by")
    matches = match_features(parent, photo)
    votes, scales = similarities(parent, photo, matches)
    placements = search_placements(parent, photo, votes, scales)
    best = _rejected("no place in the parent looks like the photo")
    for k in range(min(_TRIED, len(placements.matrices))):
        if placements.correlations[k] < _MIN_CORRELATION:
            break
        result = _place(parent, photo, matches, placements.matrices[k], max_error_px)
        if result.accepted:
            rivals = [k for k in range(k + 1, len(placements.matrices)) if _rivals(placements.correlations, k)]
            return _unless_repeated(parent, photo, result, placements.matrices[rivals[:_TRIED]])
        best = max(best, result, key=lambda r: r.score)
    return best


def _place(parent: Features, photo: Features, matches: Matches, start: np.ndarray, max_error_px: float) -> Registration:
    """Refine one placement photometrically; where moving content or relief forbid that, by its features."""
    unit = float(np.sqrt(parent.reduction.prod()))  # parent pixels per working pixel
    matrix, evidence = refine_placement(parent, photo, start)
    points = guided_matches(parent, photo, matches, matrix, _INLIER_PX * unit)
    result = _judge(parent, photo, matrix, evidence, points, max_error_px)
    if result.accepted and not result.by_features:
        return result
    footprint = photo.width / max(_scale(parent, photo, start), 1e-12)  # 1e-12: a collapsed footprint
    for origin in (matrix, start):
        wide = guided_matches(parent, photo, matches, origin, max(4 * _INLIER_PX * unit, 0.05 * footprint))
        fitted = fit_homography(wide, _INLIER_PX * unit)
        if fitted is None:
            continue
        inliers = guided_matches(parent, photo, matches, fitted, _INLIER_PX * unit)
        if len(inliers) > len(result.points):
            evidence = measure_placement(parent, photo, fitted)
            result = _judge(parent, photo, fitted, evidence, inliers, max_error_px)
    return result


def _rivals(found: np.ndarray, k: int) -> bool:
    """Whether the kth placement looks nearly as good as the best before refinement."""
    return bool(found[k] > found[0] - _RIVAL_CORRELATION)


def _unless_repeated(parent: Features, photo: Features, result: Registration, rivals: np.ndarray) -> Registration:
    """The result, or a rejection when the photo fits as well in another place: a repeated texture."""
    outline = np.array([[0, 0], [photo.width, 0], [photo.width, photo.height], [0, photo.height]], np.float64)
    corners = map_points(result.matrix[None], outline)[0]
    footprint = photo.width / result.scale
    for start in rivals:
        matrix, evidence = refine_placement(parent, photo, start)
        apart = np.abs(map_points(matrix[None], outline)[0] - corners).max()
        as_good = evidence.detail > result.score - _RIVAL_DETAIL and evidence.agreeing >= _MIN_AGREEING
        if as_good and apart > (0.5 if result.by_features else 0.1) * footprint:
            return replace(result, accepted=False, matrix=None, reason="it fits in several places equally well")
    return result


def refine(
    parent: np.ndarray, photo: np.ndarray, matrix: np.ndarray, *, max_error_px: float = MAX_ERROR_PX
) -> Registration:
    """Refine a link photometrically at the parent's full resolution.

    Only the part of the parent where the photo lies is analysed, so size does not matter. For a chain of photos refine
    link by link: a refinement of the whole chain against its first photo would lose what the closer ones know.

    Parameters
    ----------
    parent, photo : array
        See `register_pair`.
    matrix : (3, 3) float64
        Photo to parent, right within a few per cent of the footprint.
    max_error_px : float

    Returns
    -------
    Registration
        Without inliers: no features are sought.

    Raises
    ------
    FexelError
        An input is not an image, or the matrix is singular or not finite.
    """
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-30:
        raise FexelError("the matrix to refine is singular or not finite, expected an invertible 3x3 matrix")
    parent, photo = np.asarray(parent), np.asarray(photo)
    photo_features = pyramid_only(photo, max_side=_CROP_SIDE)
    window = _window(parent.shape, photo_features, matrix)
    if window is None:
        return _rejected("the photo lies outside the parent")
    x0, y0, x1, y1 = window
    crop = pyramid_only(parent[y0:y1, x0:x1], max_side=_CROP_SIDE)
    shift = np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]])
    local, evidence = refine_placement(crop, photo_features, np.linalg.inv(shift) @ matrix)
    result = _judge(crop, photo_features, local, evidence, np.zeros((0, 4)), max_error_px)
    return replace(result, matrix=shift @ result.matrix) if result.accepted else result


def _rejected(reason: str) -> Registration:
    return Registration(False, None, -1.0, reason)


def _judge(parent, photo, matrix, evidence: Evidence, points, max_error_px) -> Registration:
    """Accept a refined placement or say why not."""
    scale = _scale(parent, photo, matrix)
    # One sample per parent pixel resolves a corner to about 0.1 pixel where texture is plain, less where it is rich.
    sigma = 0.1 * max(1.0, 40.0 / np.sqrt(max(evidence.samples, 1))) * float(np.sqrt(parent.reduction.prod()))
    result = Registration(
        accepted=False,
        matrix=None,
        score=evidence.detail,
        reason=_objection(evidence, max_error_px, float(np.sqrt(parent.reduction.prod()))),
        scale=scale,
        inliers=len(points),
        rms_px=evidence.rms_px,
        sigma_px=float(np.hypot(sigma, 0.3 * min(evidence.rms_px, 1e3))),
        correlation=evidence.correlation,
        points=points,
    )
    if result.reason and _features_suffice(photo, evidence, points):
        mapped = map_points(matrix[None], points[:, :2])[0]
        rms = float(np.sqrt(np.mean(np.sum((mapped - points[:, 2:]) ** 2, axis=1))))
        reason = "" if rms <= max_error_px else _misfit(rms, max_error_px)
        result = replace(result, rms_px=rms, reason=reason, by_features=True)
    if result.reason:
        return result
    centre = matrix @ np.array([photo.width / 2, photo.height / 2, 1.0])
    return replace(result, accepted=True, matrix=matrix / centre[2])


def _features_suffice(photo: Features, evidence: Evidence, points: np.ndarray) -> bool:
    """Enough inliers, spread out, in photos that look alike."""
    return (
        len(points) >= _MIN_INLIERS
        and coverage(points[:, :2], photo.width, photo.height) >= _MIN_COVERAGE
        and evidence.correlation >= _MIN_LIKENESS
    )


def _misfit(rms_px: float, max_error_px: float) -> str:
    return f"a homography leaves {rms_px:.2f} pixels, more than {max_error_px:g}: not one plane"


def _objection(evidence: Evidence, max_error_px: float, unit_px: float) -> str:
    if evidence.blocks == 0:
        return "the place it resembles most shows no detail"
    if evidence.detail < _MIN_DETAIL or evidence.agreeing < _MIN_AGREEING:
        return (
            f"the best place found agrees in {evidence.agreeing:.0%} of its textured parts, "
            f"correlation of detail {evidence.detail:.2f}"
        )
    if evidence.rms_px > max_error_px:
        return _misfit(evidence.rms_px, max_error_px)
    if evidence.rms_px > _MAX_RESIDUAL * unit_px:
        return f"the best place found agrees only loosely, to {evidence.rms_px:.2f} pixels"
    return ""


def _scale(parent: Features, photo: Features, matrix: np.ndarray) -> float:
    """Photo pixels per parent pixel at the photo's centre."""
    across = footprint_columns(parent, photo, matrix) * float(np.sqrt(parent.reduction.prod()))
    return photo.width / max(across, 1e-12)  # 1e-12: a collapsed footprint


def _window(shape, photo, matrix):
    """Pixels of the parent that hold the footprint and a margin: x0, y0, x1, y1; None outside."""
    outline = np.array([[0, 0], [photo.width, 0], [photo.width, photo.height], [0, photo.height]], np.float64)
    corners = map_points(matrix[None] / (matrix @ [photo.width / 2, photo.height / 2, 1.0])[2], outline)[0]
    if not np.isfinite(corners).all():
        return None
    margin = 8 + _CROP_MARGIN * np.ptp(corners, axis=0).max()
    x0, y0 = np.floor(np.maximum(corners.min(axis=0) - margin, 0)).astype(int)
    x1, y1 = np.ceil(np.minimum(corners.max(axis=0) + margin, [shape[1], shape[0]])).astype(int)
    return (x0, y0, x1, y1) if x1 - x0 > 1 and y1 - y0 > 1 else None
