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
from fexel_tools.coverage import density
from fexel_tools.features import Features, detect_features
from fexel_tools.matching import match_features, similarities
from fexel_tools.photo_graph import Link
from fexel_tools.photos import Photo, load_preview
from fexel_tools.progress import Progress, silent

__all__ = ["find_links", "likeness"]

_ALL_PAIRS = 5
_LINKS_WANTED = 3
_TRIES = 6
_ROWS_PER_OCTAVE = 60
_LEAST_SCALE = 0.75  # of a vote: below, the photo would be the coarser of the two
_VOTE_COSINE = 0.82
_BLANK = 1.0 / 255.0  # standard deviation of a photo that shows nothing
_FEWEST_FEATURES = 12


@dataclass(frozen=True, eq=False)
class _Analysed:
    """Features and a fingerprint of the pixels; features None where the photo is of no use."""

    features: Features | None
    fingerprint: bytes
    problem: str


def find_links(
    photos: list[Photo | None], unusable: dict[int, str], *, jobs: int = 2, progress: Progress | None = None
) -> tuple[list[Link], dict[int, str]]:
    """Register the photos with one another.

    Parameters
    ----------
    photos : list of Photo or None
        None for those that are unusable already.
    unusable : dict of int to str
        Their numbers.
    jobs : int
        Threads.
    progress : callable(step, done, total), optional

    Returns
    -------
    links : list of Link
    rejected : dict of int to str
        Further photos that are of no use, with reasons: blank, damaged, a copy of another.
    """
    step = progress or silent
    numbers = [k for k in range(len(photos)) if k not in unusable and photos[k] is not None]
    analysed = _analyse_all([photos[k] for k in numbers], jobs, step)
    rejected = _reject(numbers, analysed, photos)
    features = {k: a.features for k, a in zip(numbers, analysed, strict=True) if k not in rejected}
    order = _ranked_pairs(features, jobs, step)
    return _register_pairs(features, order, jobs, step), rejected


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


def _ranked_pairs(features: dict[int, Features | None], jobs: int, step: Progress) -> list[tuple[int, int, int]]:
    """(likeness, coarse, fine) of every pair, the most alike first."""
    numbers = [k for k in features if features[k] is not None]
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


def _register_pairs(
    features: dict[int, Features | None], order: list[tuple[int, int, int]], jobs: int, step: Progress
) -> list[Link]:
    """Register pairs in the given order as long as one of the two photos wants more links."""
    everything = len(features) <= _ALL_PAIRS
    links: list[Link] = []
    tries, found = dict.fromkeys(features, 0), dict.fromkeys(features, 0)
    waiting = list(order)
    running: dict[Future, tuple[int, int]] = {}
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        while waiting or running:
            while waiting and len(running) < max(1, jobs):
                _, coarse, fine = waiting.pop(0)
                wanted = any(found[k] < _LINKS_WANTED and tries[k] < _TRIES for k in (coarse, fine))
                if everything or wanted:
                    tries[coarse] += 1
                    tries[fine] += 1
                    running[pool.submit(_register, features, coarse, fine)] = coarse, fine
            done, _ = wait(running, return_when=FIRST_COMPLETED) if running else (set(), None)
            for future in done:
                coarse, fine = running.pop(future)
                link = future.result()
                if link is not None:
                    links.append(link)
                    found[coarse] += 1
                    found[fine] += 1
                step("registering", len(order) - len(waiting) - len(running), len(order))
    return sorted(links, key=lambda link: (link.coarse, link.fine))


def _register(features: dict[int, Features | None], coarse: int, fine: int) -> Link | None:
    from fexel_tools.registration import register_features

    result = register_features(features[coarse], features[fine])
    raise NotImplementedError(result, density)
