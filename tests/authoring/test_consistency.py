"""All poses adjusted together agree better with the truth than chains do, and a wrong link is found out."""

from __future__ import annotations

import numpy as np
import pytest

from fexel_tools.consistency import PoseLink, adjust_poses, apply_homography, chain_poses, sample_overlap
from tests.authoring.synthetic_photos import corner_error

SIZE = (4000, 3000)
CORNERS = np.array([[0, 0], [4000, 0], [4000, 3000], [0, 3000]], float)


def true_poses(rng, count):
    poses = {0: np.eye(3)}
    for k in range(1, count):
        scale, angle = 1.0 / rng.uniform(1.5, 12.0), rng.uniform(-0.3, 0.3)
        turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        pose = np.eye(3)
        pose[:2, :2], pose[2, :2] = turn, (2e-6, 1e-6)
        pose[:2, 2] = rng.uniform(0.3, 0.7, 2) * SIZE - turn @ [2000, 1500]
        poses[k] = pose / (pose[2] @ [2000, 1500, 1])
    return poses


def four_point(source, target):
    rows, right = [], []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        right += [u, v]
    return np.append(np.linalg.solve(np.array(rows), np.array(right)), 1.0).reshape(3, 3)


def make_links(poses, rng, noise_px, share=1.0):
    links = []
    for i in poses:
        for j in poses:
            matrix = np.linalg.solve(poses[i], poses[j])
            matrix = matrix / (matrix[2] @ [2000, 1500, 1])
            finer = abs(np.linalg.det(matrix)) < 1.0
            if i == j or not finer or len(sample_overlap(matrix, SIZE, SIZE)) < 20 or (i and rng.random() > share):
                continue
            target = apply_homography(matrix, CORNERS)
            links.append(PoseLink(i, j, four_point(CORNERS, target + rng.normal(0, noise_px, (4, 2))), noise_px or 0.1))
    return links


def errors(estimate, truth):
    """Per photo, corner error in root pixels times its scale: about pixels of the photo's own."""
    return {
        k: corner_error(estimate[k], truth[k], SIZE) / np.sqrt(abs(np.linalg.det(truth[k]))) for k in truth if k != 0
    }


def test_exact_links_give_exact_poses(rng):
    truth = true_poses(rng, 8)
    adjustment = adjust_poses(make_links(truth, rng, 0.0), [SIZE] * 8, 0)
    assert adjustment.dropped == ()
    assert max(errors(adjustment.poses, truth).values()) < 1e-3
    assert max(adjustment.residual_px.values()) < 1e-4


def test_adjustment_halves_the_error_of_chains(rng):
    truth = true_poses(rng, 14)
    links = make_links(truth, rng, 0.5, share=0.6)
    chained = errors(chain_poses(links, [SIZE] * 14, 0), truth)
    adjusted = errors(adjust_poses(links, [SIZE] * 14, 0).poses, truth)
    assert np.mean(list(adjusted.values())) < 0.7 * np.mean(list(chained.values()))


@pytest.mark.parametrize("wrong", [0, 3, 9])
def test_wrong_link_is_dropped_and_does_no_harm(rng, wrong):
    """The wrong link claims to be as certain as the others, and may lie in the tree that the solution starts from."""
    truth = true_poses(rng, 10)
    links = make_links(truth, rng, 0.3)
    shift = np.array([[1, 0, 55.0], [0, 1, -31.0], [0, 0, 1]])
    link = links[wrong]
    links[wrong] = PoseLink(link.coarse, link.fine, shift @ link.coarse_from_fine, 0.2)
    adjustment = adjust_poses(links, [SIZE] * 10, 0)
    assert adjustment.dropped == (wrong,)
    assert max(errors(adjustment.poses, truth).values()) < 12.0


def test_tree_of_links_is_chained(rng):
    truth = true_poses(rng, 5)
    links = [PoseLink(0, 1, truth[1]), PoseLink(1, 2, np.linalg.solve(truth[1], truth[2]), 0.2)]
    adjustment = adjust_poses(links, [SIZE] * 5, 0)
    assert set(adjustment.poses) == {0, 1, 2}
    assert corner_error(adjustment.poses[2], truth[2], SIZE) < 1e-8


def test_chain_goes_through_finer_photos_too():
    """The root may be linked only as the finer photo of a pair."""
    pose = np.diag([2.0, 2.0, 1.0])
    poses = chain_poses([PoseLink(1, 0, np.linalg.inv(pose))], [SIZE, SIZE], 0)
    assert corner_error(poses[1], pose, SIZE) < 1e-9


def test_deep_chain_stays_exact():
    """Twelve photos, each 4 times finer: the last covers a 16-millionth of the root."""
    step = np.array([[0.25, 0, 1500.0], [0, 0.25, 1125.0], [0, 0, 1]])
    links = [PoseLink(k, k + 1, step) for k in range(12)] + [PoseLink(k, k + 2, step @ step) for k in range(11)]
    poses = adjust_poses(links, [SIZE] * 13, 0).poses
    expected = np.linalg.matrix_power(step, 12)
    assert errors({0: np.eye(3), 12: poses[12]}, {0: np.eye(3), 12: expected})[12] < 1e-3


def test_points_at_and_behind_infinity_are_nan():
    matrix = np.array([[1, 0, 0], [0, 1, 0], [-0.01, 0, 1.0]])
    mapped = apply_homography(matrix, np.array([[50.0, 1], [100, 1], [150, 1]]))
    np.testing.assert_allclose(mapped[0], (100, 2))
    assert np.isnan(mapped[1:]).all()
