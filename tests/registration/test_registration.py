"""Registration: known placements are found to sub-pixel, chance likeness is refused, every kind of image is taken."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import fexel_tools
from fexel.errors import FexelError
from fexel_tools.features import detect_features, perceptual_rgb
from fexel_tools.registration import refine, register_features, register_pair

SIZE = 384


def surface(seed: int, size: int = SIZE * 4) -> np.ndarray:
    """Texture with shapes of every size: discs and strokes over smooth noise; (size, size, 3) uint8."""
    rng = np.random.default_rng(seed)
    image = cv2.resize(
        rng.uniform(60, 190, (12, 12, 3)).astype(np.float32), (size, size), interpolation=cv2.INTER_CUBIC
    )
    for radius in np.geomspace(size / 8, size / 400, 1500):
        centre = tuple(int(c) for c in rng.integers(0, size, 2))
        colour = [float(c) for c in rng.uniform(20, 235, 3)]
        if rng.random() < 0.5:
            cv2.circle(image, centre, max(1, round(radius)), colour, -1, cv2.LINE_AA)
        else:
            end = tuple(int(c + rng.normal(0, radius * 2)) for c in centre)
            cv2.line(image, centre, end, colour, max(1, round(radius / 3)), cv2.LINE_AA)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def scene():
    return surface(7)


@pytest.fixture(scope="module")
def parent(scene):
    return cv2.resize(scene, (SIZE, SIZE), interpolation=cv2.INTER_AREA)


def photograph(scene, matrix, size=(320, 240), gain=1.0):
    """See the scene through `matrix`, photo to parent (SIZE wide), continuous pixel coordinates."""
    factor = scene.shape[1] / SIZE
    half = np.array([[1.0, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    centres = np.linalg.inv(half) @ np.diag([factor, factor, 1]) @ matrix @ half
    image = cv2.warpPerspective(scene, centres, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.clip(image * gain, 0, 255).astype(np.uint8)


def placement(scale, degrees=0.0, centre=(SIZE / 2, SIZE / 2), size=(320, 240), tilt=0.0):
    cos, sin = np.cos(np.radians(degrees)) / scale, np.sin(np.radians(degrees)) / scale
    move = np.array([[1.0, 0, -size[0] / 2], [0, 1, -size[1] / 2], [0, 0, 1]])
    turn = np.array([[cos, -sin, centre[0]], [sin, cos, centre[1]], [0, 0, 1]])
    return turn @ np.array([[1, 0, 0], [0, 1, 0], [tilt, 0, 1.0]]) @ move


def corner_distance(a, b, size=(320, 240)):
    corners = np.array([[0, 0, 1], [size[0], 0, 1], [*size, 1], [0, size[1], 1]], np.float64)
    p, q = corners @ a.T, corners @ b.T
    return np.linalg.norm(p[:, :2] / p[:, 2:] - q[:, :2] / q[:, 2:], axis=1).max()


@pytest.mark.parametrize(
    ("scale", "degrees", "tilt"), [(1.0, 5, 0.0), (2.0, -40, 2e-4), (4.0, 90, -3e-4), (6.0, 180, 0.0)]
)
def test_known_homography_is_recovered_to_a_fraction_of_a_parent_pixel(scene, parent, scale, degrees, tilt):
    truth = placement(scale, degrees, tilt=tilt)
    result = register_pair(parent, photograph(scene, truth, gain=0.8))
    assert result.accepted, result.reason
    assert corner_distance(result.matrix, truth) < 0.3
    assert result.scale == pytest.approx(scale, rel=0.02)
    assert result.reason == ""
    assert result.rms_px < 0.5


def test_area_reduction_fixes_the_pixel_convention(scene):
    parent = cv2.resize(scene, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    photo = scene[300:780, 200:840]
    truth = np.array([[0.25, 0, 50], [0, 0.25, 75], [0, 0, 1]])
    result = register_pair(parent, photo)
    assert result.accepted, result.reason
    assert corner_distance(result.matrix, truth, (640, 480)) < 0.1  # a pixel-centre convention would be 0.375 off


def test_same_photo_twice_is_the_identity(parent):
    result = register_pair(parent, parent)
    assert result.accepted, result.reason
    assert corner_distance(result.matrix, np.eye(3), (SIZE, SIZE)) < 0.05
    assert result.score > 0.9  # less than one: parent and photo are averaged differently


def test_mirrored_photo_is_rejected(scene, parent):
    photo = photograph(scene, placement(2.0))[:, ::-1]
    result = register_pair(parent, photo)
    assert not result.accepted
    assert result.matrix is None
    assert result.reason


def test_unrelated_photos_are_rejected(parent):
    for seed in (11, 12, 13):
        other = cv2.resize(surface(seed), (320, 320), interpolation=cv2.INTER_AREA)
        assert not register_pair(parent, other).accepted


def test_other_part_of_the_same_surface_is_rejected(scene):
    left, right = scene[:, : SIZE * 2], scene[:, SIZE * 2 :]
    parent = cv2.resize(left, (SIZE // 2, SIZE), interpolation=cv2.INTER_AREA)
    for top in (0, 300, 800):
        assert not register_pair(parent, right[top : top + 480, 100:740]).accepted


def bricks(rows, columns, seed=None, brick=(24, 48)):
    """Courses of equal bricks; with a seed each brick has its own shade."""
    height, width = brick
    image = np.full((rows * height, columns * width), 60, np.float32)
    rng = np.random.default_rng(seed)
    for row in range(rows):
        for column in range(-1, columns + 1):
            shade = 150 if seed is None else rng.uniform(110, 200)
            x = column * width + (row % 2) * width // 2
            image[row * height + 2 : (row + 1) * height - 2, max(x + 2, 0) : max(x + width - 2, 0)] = shade
    return image.astype(np.uint8)


def test_bricks_that_all_look_alike_are_rejected():
    wall = bricks(16, 8)
    photo = cv2.resize(wall[72:216, 96:288], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    result = register_pair(wall, photo)
    assert not result.accepted
    assert "several places" in result.reason


def test_bricks_of_another_wall_are_rejected_or_of_this_wall_found():
    wall, other = bricks(16, 8, seed=1), bricks(16, 8, seed=2)
    window = np.s_[72:216, 96:288]
    truth = np.array([[0.5, 0, 96], [0, 0.5, 72], [0, 0, 1]])
    found = register_pair(wall, cv2.resize(wall[window], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC))
    assert found.accepted, found.reason
    assert corner_distance(found.matrix, truth, (384, 288)) < 0.5
    assert not register_pair(wall, cv2.resize(other[window], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)).accepted


@pytest.mark.parametrize("value", [0, 128, 255])
def test_blank_photo_is_rejected_with_a_reason(parent, value):
    blank = np.full((200, 300, 3), value, np.uint8)
    assert register_pair(parent, blank).reason == "the photo shows nothing to register by"
    assert register_pair(blank, parent).reason == "the parent shows nothing to register by"


def test_noise_is_rejected(parent, rng):
    noise = rng.integers(0, 256, (240, 320, 3)).astype(np.uint8)
    assert not register_pair(parent, noise).accepted
    assert not register_pair(noise, rng.integers(0, 256, (240, 320, 3)).astype(np.uint8)).accepted


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 50), (3, 400, 3), (15, 15), (20, 17, 4)])
def test_tiny_image_is_a_reason_and_no_exception(parent, shape, rng):
    tiny = rng.integers(0, 256, shape).astype(np.uint8)
    for result in (register_pair(parent, tiny), register_pair(tiny, parent)):
        assert not result.accepted
        assert result.reason


def variants(photo):
    linear = (photo.astype(np.float32) / 255) ** 2.2
    return {
        "uint16": photo.astype(np.uint16) * 257,
        "float": linear * 40,
        "double": linear.astype(np.float64),
        "half": linear.astype(np.float16),
        "grey": cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY),
        "rgba": np.dstack([photo, np.full(photo.shape[:2], 255, np.uint8)]),
        "strided": np.repeat(photo, 2, axis=1)[:, ::2],
    }


@pytest.mark.parametrize("kind", ["uint16", "float", "double", "half", "grey", "rgba", "strided"])
def test_every_kind_of_image_gives_the_same_placement(scene, parent, kind):
    truth = placement(3.0, 25)
    result = register_pair(parent, variants(photograph(scene, truth))[kind])
    assert result.accepted, result.reason
    assert corner_distance(result.matrix, truth) < 0.3


def test_non_finite_and_negative_floats_count_as_black(scene):
    linear = (photograph(scene, placement(2.0)).astype(np.float32) / 255) ** 2.2
    damaged, black = linear.copy(), linear.copy()
    damaged[50:60, 50:60], damaged[80, 80], damaged[90, 90] = np.nan, np.inf, -4
    black[50:60, 50:60], black[80, 80], black[90, 90] = 0, 0, 0
    assert np.array_equal(perceptual_rgb(damaged), perceptual_rgb(black))


@pytest.mark.parametrize(
    "image",
    [
        np.zeros(5, np.uint8),
        np.zeros((4, 4, 5), np.uint8),
        np.zeros((0, 4, 3), np.uint8),
        np.zeros((4, 4), np.int32),
        np.zeros((4, 4), bool),
    ],
)
def test_what_is_no_image_is_an_error(parent, image):
    with pytest.raises(FexelError, match="expected"):
        register_pair(parent, image)


def test_result_does_not_depend_on_the_run_nor_touch_global_random_state(scene, parent):
    photo = photograph(scene, placement(4.0, 33))
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first, second = register_pair(parent, photo), register_pair(parent, photo, seed=5)
    assert np.array_equal(first.matrix, second.matrix)
    assert first.score == second.score
    assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_features_found_once_give_the_same_as_the_pair(scene, parent):
    photo = photograph(scene, placement(3.0, -15))
    by_features = register_features(detect_features(parent), detect_features(photo))
    assert np.array_equal(by_features.matrix, register_pair(parent, photo).matrix)


def test_large_images_are_worked_on_reduced_and_refined_in_full(scene):
    truth = np.array([[0.5, 0, 400], [0, 0.5, 500], [0, 0, 1]])
    photo = cv2.resize(scene[500:740, 400:720], None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    result = register_pair(scene, photo, max_side=512)
    assert result.accepted, result.reason
    assert corner_distance(result.matrix, truth, (640, 480)) < 0.3


def test_refine_improves_a_disturbed_link(scene, parent):
    truth = placement(3.0, 20)
    photo = photograph(scene, truth)
    disturbed = np.array([[1.0, 0.01, 1.5], [-0.01, 1, -1.2], [0, 0, 1]]) @ truth
    result = refine(parent, photo, disturbed)
    assert result.accepted, result.reason
    assert corner_distance(disturbed, truth) > 2
    assert corner_distance(result.matrix, truth) < 0.3


def test_chain_of_refined_links_reaches_a_scale_that_is_out_of_reach_directly(scene, parent):
    middle_truth, child_truth = placement(4.0, 10), placement(16.0, 50, (SIZE / 2 + 4, SIZE / 2 - 3))
    middle, child = photograph(scene, middle_truth), photograph(scene, child_truth)
    first, second = register_pair(parent, middle), register_pair(middle, child)
    assert first.accepted, first.reason
    assert second.accepted, second.reason
    assert corner_distance(first.matrix @ second.matrix, child_truth) < 0.3


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), np.full((3, 3), np.nan), np.eye(2)])
def test_refining_a_degenerate_matrix_is_an_error(parent, matrix):
    with pytest.raises(FexelError, match="invertible"):
        refine(parent, parent, matrix)


def test_refining_outside_the_parent_is_a_reason(parent):
    result = refine(parent, parent, np.array([[1.0, 0, 5000], [0, 1, 0], [0, 0, 1]]))
    assert not result.accepted
    assert "outside" in result.reason


def test_lens_distortion_is_reported_as_a_residual_and_bounded_by_max_error(scene):
    parent = cv2.resize(scene, (SIZE * 2, SIZE * 2), interpolation=cv2.INTER_AREA)
    analysed = detect_features(parent)
    y, x = np.mgrid[0:480, 0:640].astype(np.float32)
    radius2 = ((x - 320) ** 2 + (y - 240) ** 2) / 320**2
    bent = 1 + 0.015 * radius2
    map_x, map_y = (x - 320) * bent + SIZE * 2, (y - 240) * bent + SIZE * 2
    photo = cv2.remap(scene, map_x, map_y, cv2.INTER_LINEAR)
    window = scene[SIZE * 2 - 240 : SIZE * 2 + 240, SIZE * 2 - 320 : SIZE * 2 + 320]
    straight = register_features(analysed, detect_features(window))
    bent_features = detect_features(photo)
    lens = register_features(analysed, bent_features)
    assert straight.accepted, straight.reason
    assert lens.accepted, lens.reason
    assert lens.rms_px > 2 * straight.rms_px
    strict = register_features(analysed, bent_features, max_error_px=0.5 * lens.rms_px)
    assert not strict.accepted
    assert "not one plane" in strict.reason


def test_register_pair_is_public():
    assert fexel_tools.register_pair is register_pair
