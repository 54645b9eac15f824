"""The minification example stages show what their READMEs promise: the skull, every filter, haze, a flight."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

import fexel
from fexel.filters import PORTABLE_FILTERS
from fexel.images import linear_to_srgb

FOLDER = Path(__file__).resolve().parents[2] / "stages"
TEXTURES = {"fipmap_anamorphosis": "/World/Materials/Painting/Image", "fipmap_floor": "/World/Materials/Chart/Image"}
FINER = 8  # pixels of the truth along a pixel


def open_stage(name: str, **variants: str) -> Usd.Stage:
    stage = Usd.Stage.Open(str(FOLDER / name / f"{name}.usda"))
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for variant_set, variant in variants.items():
            assert stage.GetDefaultPrim().GetVariantSets().SetSelection(variant_set, variant) is not False
    return stage


@pytest.fixture(scope="module")
def renderer():
    with fexel.Renderer() as renderer:
        yield renderer


# The skull's outline, in pixels of the painting: what is the crown and the jaw from the eye that it was painted for.
OUTLINE = [(745, 783), (640, 810), (520, 868), (400, 935), (330, 975), (300, 1005), (380, 1010), (450, 975), (540, 912)]
OUTLINE += [(620, 865), (700, 828)]


def seen_outline(camera: str) -> np.ndarray:
    """(N, 2): the outline in the picture of a camera."""
    stage = open_stage("fipmap_anamorphosis")
    width, height = UsdGeom.Mesh.Get(stage, "/World/Painting").GetExtentAttr().Get()[1][:2]
    pixels = np.array(OUTLINE, np.float64)
    world = np.stack([width * (pixels[:, 0] / 519.5 - 1), height * (1 - pixels[:, 1] / 512), 0 * pixels[:, 0]], -1)
    camera_to_world = np.array(UsdGeom.Camera.Get(stage, f"/World/Cameras/{camera}").ComputeLocalToWorldTransform(0))
    inside = np.concatenate([world, np.ones((len(world), 1))], 1) @ np.linalg.inv(camera_to_world)
    return inside[:, :2] / -inside[:, 2:3]


def elongation(points: np.ndarray) -> float:
    """Longer over shorter axis."""
    values = np.linalg.eigvalsh(np.cov(points.T))
    return float(np.sqrt(values[1] / values[0]))


def test_skull_is_as_round_as_a_skull_from_the_right_margin_alone():
    assert elongation(seen_outline("Overview")) > 5
    assert elongation(seen_outline("Detail")) < 1.8


def test_eye_of_the_skull_is_at_the_right_margin_a_third_up_and_close_to_the_wall():
    stage = open_stage("fipmap_anamorphosis")
    low, high = (np.array(p) for p in UsdGeom.Mesh.Get(stage, "/World/Painting").GetExtentAttr().Get())
    matrix = np.array(UsdGeom.Camera.Get(stage, "/World/Cameras/Detail").ComputeLocalToWorldTransform(0))
    eye, view = matrix[3, :3], -matrix[2, :3]
    margin = eye + view * (high[0] - eye[0]) / view[0]  # where the line of sight crosses the plane of the right margin
    assert eye[0] > high[0] and 0.1 < eye[2] < 0.25
    assert (margin[1] - low[1]) / (high[1] - low[1]) == pytest.approx(1 / 3, abs=0.05)


def test_walk_ends_where_the_skull_is_right():
    stage = open_stage("fipmap_anamorphosis")
    walk, detail = (UsdGeom.Camera.Get(stage, f"/World/Cameras/{name}") for name in ("Walk", "Detail"))
    np.testing.assert_allclose(walk.ComputeLocalToWorldTransform(48), detail.ComputeLocalToWorldTransform(0), atol=1e-6)


@pytest.mark.parametrize("name", TEXTURES)
def test_every_filter_is_a_variant_and_the_fipmap_is_selected(name):
    stage = open_stage(name)
    assert stage.GetDefaultPrim().GetVariantSets().GetVariantSelection("filter") == "fipmap"
    for token in PORTABLE_FILTERS:
        variant = open_stage(name, filter=token)
        api = fexel.TextureMinificationAPI.Get(variant, TEXTURES[name])
        assert api and api.GetFilterAttr().Get() == token


def decibels(renderer: fexel.Renderer, name: str, width: int, height: int) -> dict[str, float]:
    """Of each filter against the mean of a finer picture, in linear light; both sRGB-encoded."""
    size = {"width": FINER * width, "height": FINER * height}
    fine = renderer.render(open_stage(name, filter="anisotropic"), camera="Detail", **size)["color"][..., :3]
    truth = linear_to_srgb(fine.reshape(height, FINER, width, FINER, 3).mean((1, 3)).clip(0, 1))
    found = {}
    for token in PORTABLE_FILTERS:
        color = renderer.render(open_stage(name, filter=token), camera="Detail", width=width, height=height)["color"]
        error = np.mean((linear_to_srgb(color[..., :3].clip(0, 1)) - truth) ** 2)
        found[token] = float(-10 * np.log10(error))
    return found


def test_fipmap_shows_the_skull_sharper_than_mipmap_and_ripmap(renderer):
    found = decibels(renderer, "fipmap_anamorphosis", 160, 160)
    assert found["fipmap"] > found["ripmap"] + 5 > found["mipmap"] + 10


def test_fipmap_shows_the_floor_better_than_all_others(renderer):
    """Than the eight probes of the default, too, which fetch four times as much."""
    found = decibels(renderer, "fipmap_floor", 240, 135)
    assert found["fipmap"] > found["anisotropic"] + 1.5
    assert found["anisotropic"] > found["ripmap"] + 3 > found["mipmap"] + 6


def test_haze_takes_the_contrast_of_what_is_far(renderer):
    rows = {}
    for haze in ("none", "hazy"):
        color = renderer.render(open_stage("fipmap_floor", haze=haze), camera="Overview", width=160)["color"]
        rows[haze] = color[..., :3][color[..., 3].min(1) > 0.999]  # of the floor, the farthest first
    np.testing.assert_allclose(rows["hazy"][0].mean(0), (0.62, 0.7, 0.8), atol=0.03)
    near = rows["hazy"][-5:].std() / rows["none"][-5:].std()
    assert 0.7 < near < 0.98
    assert rows["hazy"][:8].std() < 0.5 * rows["none"][:8].std() + 0.05


def test_flight_has_no_jump_where_the_direction_of_footprints_changes(renderer):
    """Frames a hundredth of a step apart differ by what has moved: no more with a fipmap than with probes."""
    change = {}
    for token in ("anisotropic", "fipmap"):
        stage = open_stage("fipmap_floor", filter=token)
        pairs = [
            [renderer.render(stage, camera="Flight", time=t + dt, width=160)["color"] for dt in (0.0, 0.01)]
            for t in (12.0, 24.0, 30.0, 36.0, 42.0)
        ]
        change[token] = max(float(np.abs(a - b).mean()) for a, b in pairs)
    assert change["fipmap"] < 1.5 * change["anisotropic"]
