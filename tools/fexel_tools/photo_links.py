"""Which photos show the same, and how they map to one another: registration pair by pair.

Features are found once per photo. Not every pair is worth a full registration: of n photos each gets a likeness to
every other, from a few hundred of its features at all sizes: every match votes for a similarity, and the likeness is
the size of the largest group of votes that agree. Pairs are then registered by falling likeness, until every photo
has `_LINKS_WANTED` links to others or has tried `_TRIES` times: a tree alone would do, loops make the poses better
and show wrong links. Up to `_ALL_PAIRS` photos every pair is registered.

Conventions: continuous pixel coordinates of upright photos; 3x3 float64, column vectors.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass

import numpy as np

from fexel.errors import FexelError
from fexel_tools.features import Features, detect_features
from fexel_tools.matching import match_features, similarities
from fexel_tools.photo_graph import Link
from fexel_tools.photos import Photo, load_preview
from fexel_tools.progress import Progress, silent
from fexel_tools.registration import MAX_ERROR_PX, register_features

__all__ = ["PhotoLinks", "find_links", "likeness"]

_ALL_PAIRS = 5
_LINKS_WANTED = 3
_UNLIKELY = 8  # unrelated photos reach a likeness of 3 to 7, related ones tens; the zoom may leave them few
_TRIES = 6
_BRIDGE_TRIES = 12  # of a photo whose set lies apart from the others
_ROWS_PER_OCTAVE = 60
_LEAST_SCALE = 0.75  # of a vote: below, the photo would be the coarser of the two
_VOTE_COSINE = 0.82
_BLANK = 1.0 / 255.0  # standard deviation of a photo that shows nothing
_FEWEST_FEATURES = 12


@dataclass(frozen=True, eq=False)
class PhotoLinks:
    """What matching found.

    Attributes
    ----------
    links : list of Link
    rejected : dict of int to str
        Photos that are of no use, with reasons: blank, damaged, a copy of another.
    failures : dict of int to (int, str)
        Of each photo the other photo that came nearest to a match without being one, and why it is none.
    """

    links: list[Link]
    rejected: dict[int, str]
    failures: dict[int, tuple[int, str]]


@dataclass(frozen=True, eq=False)
class _Analysed:
    """Features and a fingerprint of the pixels; features None where the photo is of no use."""

    features: Features | None
    fingerprint: bytes
    problem: str


def find_links(
    photos: list[Photo | None],
    unusable: dict[int, str],
    *,
    max_error_px: float = MAX_ERROR_PX,
    jobs: int = 2,
    progress: Progress | None = None,
) -> PhotoLinks:
    """Register the photos with one another.

    Parameters
    ----------
    photos : list of Photo or None
        None for those that are unusable already.
    unusable : dict of int to str
        Their numbers.
    max_error_px : float
        Greatest residual of a homography, pixels of the coarser photo.
    jobs : int
        Threads.
    progress : callable(step, done, total), optional

    Returns
    -------
    PhotoLinks
    """
    step = progress or silent
    numbers = [k for k in range(len(photos)) if k not in unusable and photos[k] is not None]
    analysed = _analyse_all([photos[k] for k in numbers], jobs, step)
    rejected = _reject(numbers, analysed, photos)
    features = {k: a.features for k, a in zip(numbers, analysed, strict=True) if a.features and k not in rejected}
    search = _Search(features, _ranked_pairs(features, jobs, step), max_error_px)
    search.run(jobs, step)
    return PhotoLinks(search.links, rejected, {k: (other, why) for k, (_, other, why) in search.failures.items()})


def likeness(parent: Features, photo: Features) -> int:
    """Number of matches that agree on one similarity from `photo` to `parent`, `photo` being the finer of the two."""
    matches = match_features(parent, photo, neighbours=1, per_octave=_ROWS_PER_OCTAVE)
    good = matches.cosine > _VOTE_COSINE
    if np.count_nonzero(good) < 2:
        return 0
    matrices, scales = similarities(parent, photo, matches)
    good &= scales > _LEAST_SCALE
    matrices, scales = matrices[good], scales[good]
    if not len(scales):
        return 0
    centers = matrices[:, :2, :2] @ np.array([photo.width / 2.0, photo.height / 2.0]) + matrices[:, :2, 2]
    angles = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
    turn = np.abs((angles[:, None] - angles[None, :] + np.pi) % (2.0 * np.pi) - np.pi)
    zoom = np.abs(np.log2(scales[:, None] / scales[None, :]))
    field = np.hypot(photo.width, photo.height) / np.sqrt(scales[:, None] * scales[None, :])
    apart = np.linalg.norm(centers[:, None] - centers[None, :], axis=2) / field
    return int(((turn < 0.35) & (zoom < 0.6) & (apart < 0.2)).sum(axis=1).max())


def _analyse_all(photos: list[Photo], jobs: int, step: Progress) -> list[_Analysed]:
    results = []
    step("features", 0, len(photos))
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        for result in pool.map(_analyse, photos):
            results.append(result)
            step("features", len(results), len(photos))
    return results


def _analyse(photo: Photo) -> _Analysed:
    try:
        preview = load_preview(photo)
    except FexelError as error:
        return _Analysed(None, b"", str(error).removeprefix(f"{photo.file}: "))
    fingerprint = hashlib.sha256(repr(preview.shape).encode() + preview.tobytes()).digest()
    if preview[::2, ::2].astype(np.float32).std() < _BLANK * 255.0:
        return _Analysed(None, fingerprint, "blank: nothing to be matched")
    features = detect_features(preview)
    if len(features.points) < _FEWEST_FEATURES:
        problem = f"{len(features.points)} features found, too few to be matched"
        return _Analysed(None, fingerprint, problem)
    return _Analysed(features, fingerprint, "")


def _reject(numbers: list[int], analysed: list[_Analysed], photos: list[Photo | None]) -> dict[int, str]:
    rejected: dict[int, str] = {}
    seen: dict[bytes, int] = {}
    for k, result in zip(numbers, analysed, strict=True):
        if result.fingerprint and result.fingerprint in seen:
            rejected[k] = f"duplicate of '{photos[seen[result.fingerprint]].file}'"
        elif result.features is None:
            # The only usable photo makes a stage all the same, blank or not.
            if len(numbers) > 1 or not result.fingerprint:
                rejected[k] = result.problem
        else:
            seen[result.fingerprint] = k
    return rejected


def _ranked_pairs(features: dict[int, Features], jobs: int, step: Progress) -> list[tuple[int, int, int]]:
    """(likeness, coarse, fine) of every pair, the most alike first."""
    numbers = list(features)
    pairs = [(a, b) for i, a in enumerate(numbers) for b in numbers[i + 1 :]]

    def rank(pair: tuple[int, int]) -> tuple[int, int, int]:
        a, b = pair
        forward, backward = likeness(features[a], features[b]), likeness(features[b], features[a])
        return (forward, a, b) if forward >= backward else (backward, b, a)

    ranked = []
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        for result in pool.map(rank, pairs):
            ranked.append(result)
            step("comparing photos", len(ranked), len(pairs))
    return sorted(ranked, key=lambda r: (-r[0], r[1], r[2]))


class _Search:
    """Registers pairs, the likely ones first, for as long as a photo wants links or sets of photos lie apart."""

    def __init__(self, features: dict[int, Features], order: list[tuple[int, int, int]], max_error_px: float) -> None:
        self.links: list[Link] = []
        self.failures: dict[int, tuple[float, int, str]] = {}  # photo -> best score, the other photo, reason
        self._features, self._max_error_px = features, max_error_px
        self._waiting = list(order)
        self._everything = len(features) <= _ALL_PAIRS
        self._tries, self._found = dict.fromkeys(features, 0), dict.fromkeys(features, 0)
        self._group = {k: k for k in features}

    def run(self, jobs: int, step: Progress) -> None:
        total = len(self._waiting)
        running: dict[Future, tuple[int, int]] = {}
        with ThreadPoolExecutor(max(1, jobs)) as pool:
            while True:
                while len(running) < max(1, jobs) and (pair := self._next()) is not None:
                    running[pool.submit(_register, self._features, *pair, self._max_error_px)] = pair
                if not running:
                    break
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    self._note(*running.pop(future), future.result())
                step("registering", total - len(self._waiting) - len(running), total)
        step("registering", total, total)
        self.links.sort(key=lambda link: (link.coarse, link.fine))

    def _next(self) -> tuple[int, int] | None:
        for k, (alike, *pair) in enumerate(self._waiting):
            wanted = alike > _UNLIKELY and (self._everything or any(self._wants(photo) for photo in pair))
            if wanted or self._bridges(pair):
                for photo in pair:
                    self._tries[photo] += 1
                del self._waiting[k]
                return tuple(pair)
        return None

    def _wants(self, photo: int) -> bool:
        return self._found[photo] < _LINKS_WANTED and self._tries[photo] < _TRIES

    def _bridges(self, pair: list[int]) -> bool:
        """Whether the pair would join sets of photos that have no link yet, one of them not tried often."""
        apart = self._find(pair[0]) != self._find(pair[1])
        return apart and min(self._tries[photo] for photo in pair) < _BRIDGE_TRIES

    def _note(self, coarse: int, fine: int, result: Link | tuple[float, str]) -> None:
        if isinstance(result, Link):
            self.links.append(result)
            self._found[coarse] += 1
            self._found[fine] += 1
            self._group[self._find(coarse)] = self._find(fine)
            return
        for photo, other in ((coarse, fine), (fine, coarse)):
            if photo not in self.failures or result[0] > self.failures[photo][0]:
                self.failures[photo] = result[0], other, result[1]

    def _find(self, photo: int) -> int:
        while self._group[photo] != photo:
            photo = self._group[photo]
        return photo


def _register(features: dict[int, Features], coarse: int, fine: int, max_error_px: float) -> Link | tuple[float, str]:
    """The link, or score and reason of the failure."""
    result = register_features(features[coarse], features[fine], max_error_px=max_error_px)
    if not result.accepted or result.matrix is None:
        return result.score, result.reason
    return Link(
        coarse=coarse,
        fine=fine,
        coarse_from_fine=result.matrix,
        scale=result.scale,
        score=result.score,
        inliers=result.inliers,
        rms_px=result.rms_px,
        sigma_px=result.sigma_px,
    )
