"""Registration of photos at very different zoom: success by scale, chains, false positives, time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from bench.harness import Curve, Row, progress, shared_data, time_alternately
from bench.registration_truth import PHOTOS, Case, corner_error, load_photo, make_case, make_chain
from fexel_tools.features import Features, detect_features
from fexel_tools.registration import register_features, register_pair

__all__ = ["NAME", "evaluate", "false_positive_sets", "rows"]

NAME = "registration"

_SEED = 20260
_TARGETS = {2: 97, 4: 97, 6: 97, 8: 97, 12: 92, 16: 90, 24: 70}
_SIFT = {2: 100, 4: 86, 6: 71, 8: 93, 12: 64, 16: 36, 24: 0}  # SIFT, ratio test, MAGSAC; measured beforehand
_CHAIN = (6.0, 40.0)  # a photo between brings scale 40 within reach
_WRONG_PX = 3.0
_WINDOWS = 12  # of each photo; against the photo's own other part, all of them
_UNRELATED_WINDOWS = 4  # against every other photo: more than 1000 pairs
_TEXTURES = (
    *PHOTOS,
    "umbrella/backgrounds/grass_rotate_01.jpg",
    "umbrella/backgrounds/pebbles_01.jpg",
    "umbrella/backgrounds/brick_gray.png",
    "umbrella/backgrounds/gravel_gray.png",
    "umbrella/backgrounds/grass_gray.png",
    "multiview/lund_door/images/DSC_0001.jpg",
    "multiview/stone_wall/images/mono_wall_01.jpg",
    "zoom/beach/beach01.jpg",
    "zoom/mountain/mountain_7p1mm.jpg",
    "pinch/normalmaps/brick_mask_1024.jpg",
)


def rows(quick: bool) -> Iterator[Row]:
    """Every figure of registration; without the shared photos none."""
    folder = shared_data()
    if folder is None:
        return
    per_photo = 1 if quick else 2
    for scale, target in _TARGETS.items():
        cases = _cases(folder, scale, 1024, per_photo)
        yield _success_row(cases, f"width 1024, scale {scale}", target, f"SIFT + ratio + MAGSAC {_SIFT[scale]} %")
    for scale, before in ((12, 89), (24, 100)):
        cases = _cases(folder, scale, 2048, per_photo)
        yield _success_row(cases, f"width 2048, scale {scale}", 95, f"measured beforehand {before} %")
    yield _chain_row(folder, per_photo)
    yield from _false_positive_rows(folder, quick)
    yield _time_row(folder, 3 if quick else 7)


def evaluate(case: Case) -> tuple[bool, float]:
    """Register a pair.

    Returns
    -------
    success : bool
        Corner error below 1 % of the child's footprint and below one parent texel.
    error : float
        Largest corner error, parent texels; infinite when rejected.
    """
    found = register_pair(case.parent, case.child)
    if not found.accepted:
        return False, np.inf
    height, width = case.child.shape[:2]
    error = corner_error(found.matrix, case.matrix, width, height)
    return error < min(0.01 * width / case.scale, 1.0), error


def false_positive_sets(folder: Path, quick: bool) -> tuple[list[Features], list[list[Features]]]:
    """Left part of each photo, and windows of its right part that share nothing with it."""
    parents, windows = [], []
    for index, name in enumerate(_TEXTURES[::3] if quick else _TEXTURES):
        photo = (load_photo(folder / name) ** (1 / 2.2) * 255).astype(np.uint8)
        photo = cv2.resize(photo, (1024, round(1024 * photo.shape[0] / photo.shape[1])), interpolation=cv2.INTER_AREA)
        parents.append(detect_features(photo[:, :500]))
        rng = np.random.default_rng([_SEED, index])
        windows.append([detect_features(_window(photo[:, 524:], rng)) for _ in range(3 if quick else _WINDOWS)])
    return parents, windows


def _window(image, rng):
    """A randomly rotated and enlarged part."""
    height, width = image.shape[:2]
    zoom, turn = rng.uniform(1.5, 4), rng.uniform(-180, 180)
    centre = (float(rng.uniform(0.3, 0.7) * width), float(rng.uniform(0.3, 0.7) * height))
    matrix = cv2.getRotationMatrix2D(centre, turn, zoom)
    matrix[:, 2] += np.array([256, 192]) - centre
    return cv2.warpAffine(image, matrix, (512, 384), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)


def _cases(folder, scale, width, per_photo) -> Iterator[Case]:
    for index, name in enumerate(progress(PHOTOS, f"registration, scale {scale}, width {width}")):
        photo = load_photo(folder / name)
        if photo.shape[1] < width:
            continue
        for k in range(per_photo):
            case = make_case(Path(name).stem, photo, scale, np.random.default_rng([_SEED, index, scale, k]), width)
            if case is not None:
                yield case


def _success_row(cases, setting, target, reference) -> Row:
    outcomes = [evaluate(case) for case in cases]
    return Row(
        measure="registration, success",
        setting=setting,
        value=100.0 * float(np.mean([success for success, _ in outcomes])) if outcomes else float("nan"),
        unit="%",
        target=float(target),
        comparison=">=",
        reference=reference,
        samples=len(outcomes),
        note=f"{sum(success for success, _ in outcomes)} of {len(outcomes)}; accepted but more than "
        f"{_WRONG_PX:g} texels off: {sum(_WRONG_PX < error < np.inf for _, error in outcomes)}",
    )


def _chain_row(folder, per_photo) -> Row:
    successes = []
    for index, name in enumerate(progress(PHOTOS, "registration, chains")):
        photo = load_photo(folder / name)
        for k in range(per_photo):
            rng = np.random.default_rng([_SEED, index, 40, k])
            chain = make_chain(Path(name).stem, photo, _CHAIN, rng)
            if chain:
                successes.append(_chain_succeeds(chain))
    return Row(
        measure="registration, success of chains",
        setting=f"width 1024, scales {' x '.join(f'{s:g}' for s in _CHAIN)} of the first photo",
        value=100.0 * float(np.mean(successes)) if successes else float("nan"),
        unit="%",
        target=75.0,
        comparison=">=",
        reference="measured beforehand 50 %",
        samples=len(successes),
        note="corner error of the product below 1 parent texel and 1 % of the footprint of the link's photo",
    )


def _chain_succeeds(chain: list[Case]) -> bool:
    """The product of the links against the product of the truths."""
    estimate, truth = np.eye(3), np.eye(3)
    for case in chain:
        found = register_pair(case.parent, case.child)
        if not found.accepted:
            return False
        estimate, truth = estimate @ found.matrix, truth @ case.matrix
    height, width = chain[-1].child.shape[:2]
    return corner_error(estimate, truth, width, height) < min(1.0, 0.01 * width / _CHAIN[-1])


def _false_positive_rows(folder, quick) -> Iterator[Row]:
    parents, windows = false_positive_sets(folder, quick)
    several = range(len(parents))
    unrelated = [
        (parents[i], photo) for i in several for j in several if i != j for photo in windows[j][:_UNRELATED_WINDOWS]
    ]
    same = [(parents[i], photo) for i in range(len(parents)) for photo in windows[i]]
    pairs = (("unrelated photos", unrelated, 0.1), ("other parts of the same surface, repeated textures", same, 0.5))
    for setting, members, target in pairs:
        accepted = sum(register_features(*pair).accepted for pair in progress(members, f"registration, {setting}"))
        yield Row(
            measure="registration, false positives",
            setting=setting,
            value=100.0 * accepted / len(members),
            unit="%",
            target=target,
            comparison="<=",
            reference="pipelines measured beforehand 0 to 6 %; 0 to 2 %",
            samples=len(members),
            note=f"{accepted} of {len(members)} accepted, none of which can be right",
        )


def _time_row(folder, repeats) -> Row:
    case = next(_cases(folder, 6, 1024, 1))
    sift = cv2.SIFT_create()
    greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (case.parent, case.child)]
    times = time_alternately(
        {
            "ours": lambda: register_pair(case.parent, case.child),
            "sift": lambda: [sift.detectAndCompute(grey, None) for grey in greys],
        },
        repeats=repeats,
    )
    return Row(
        measure="registration, time of a pair",
        setting="width 1024",
        value=times["ours"].median_s,
        unit="s",
        target=1.5,
        comparison="<=",
        reference=f"OpenCV's SIFT of both photos alone, in the same run: {times['sift'].median_s:.2f} s",
        spread=times["ours"].spread_s,
        samples=repeats,
    )


def curves(quick: bool) -> Iterator[Curve]:
    """Success against scale on few pairs, with the median time of a pair: ours, and OpenCV's usual pipeline."""
    folder = shared_data()
    if folder is None:
        return
    scales = (4, 12, 24) if quick else tuple(_TARGETS)
    ways = {"fexel": _our_matrix, "OpenCV: SIFT, ratio test, MAGSAC": _sift_matrix}
    successes = {label: {scale: [] for scale in scales} for label in ways}
    seconds = {label: [] for label in ways}
    for scale, case in _few_cases(folder, scales, PHOTOS[:2] if quick else PHOTOS[:5]):
        for label, way in ways.items():
            start = time.perf_counter()
            matrix = way(case)
            seconds[label].append(time.perf_counter() - start)
            successes[label][scale].append(_is_right(matrix, case))
    for label, by_scale in successes.items():
        yield Curve(
            plot="registration",
            label=f"{label} ({np.median(seconds[label]):.1f} s a pair)",
            x=[float(scale) for scale in scales],
            y=[100 * float(np.mean(by_scale[scale])) if by_scale[scale] else float("nan") for scale in scales],
            x_label="scale between the photos, width 1024",
            y_label=f"success, % of about {len(by_scale[scales[0]])} pairs each",
            ours=label == "fexel",
        )


def _few_cases(folder: Path, scales, names) -> Iterator[tuple[int, Case]]:
    """One pair of each photo and scale, the same as of `rows`."""
    for index, name in enumerate(progress(names, "registration, curves")):
        photo = load_photo(folder / name)
        for scale in scales:
            case = make_case(Path(name).stem, photo, scale, np.random.default_rng([_SEED, index, scale, 0]))
            if case is not None:
                yield scale, case


def _is_right(matrix: np.ndarray | None, case: Case) -> bool:
    if matrix is None:
        return False
    height, width = case.child.shape[:2]
    return corner_error(matrix, case.matrix, width, height) < min(0.01 * width / case.scale, 1.0)


def _our_matrix(case: Case) -> np.ndarray | None:
    found = register_pair(case.parent, case.child)
    return found.matrix if found.accepted else None


def _sift_matrix(case: Case) -> np.ndarray | None:
    """SIFT with OpenCV's defaults, ratio 0.8, MAGSAC at 3 pixels; continuous pixel coordinates."""
    sift = cv2.SIFT_create()
    greys = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (case.child, case.parent)]
    (child, child_words), (parent, parent_words) = (sift.detectAndCompute(grey, None) for grey in greys)
    if child_words is None or parent_words is None or len(parent_words) < 2:
        return None
    pairs = cv2.BFMatcher().knnMatch(child_words, parent_words, k=2)
    kept = [best for best, second in pairs if best.distance < 0.8 * second.distance]
    if len(kept) < 4:
        return None
    source = np.float64([child[match.queryIdx].pt for match in kept]) + 0.5
    target = np.float64([parent[match.trainIdx].pt for match in kept]) + 0.5
    return cv2.findHomography(source, target, cv2.USAC_MAGSAC, 3.0, maxIters=10_000, confidence=0.999)[0]
