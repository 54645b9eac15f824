"""`fexel.render` and `fexel.Renderer` on stages."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Usd
from scenes import draw, quad, scene, settings

import fexel
from fexel.errors import FexelError
from fexel.renderer import frame
from stages import two_camera_stage


def test_render_takes_paths_and_stages_alike(tmp_path):
    stage = two_camera_stage(tmp_path / "shot.usda")
    options = {"camera": "Near", "width": 48, "time": 2, "aovs": ("color", "depth")}
    from_path = fexel.render(tmp_path / "shot.usda", **options)
    from_text = fexel.render(str(tmp_path / "shot.usda"), texture_memory_mb=64, **options)
    from_stage = fexel.render(stage, **options)
    assert from_path["color"].shape == (24, 48, 4) and from_path["depth"].shape == (24, 48, 1)
    for name, image in from_path.items():
        assert image.dtype == np.float32
        assert np.array_equal(image, from_text[name]) and np.array_equal(image, from_stage[name])


def test_height_conforms_the_camera(tmp_path):
    stage = two_camera_stage(tmp_path / "shot.usda")
    wide = fexel.render(stage, camera="Near", width=48, height=24, aovs=("alpha",))["alpha"]
    square = fexel.render(stage, camera="Near", width=48, height=48, aovs=("alpha",))["alpha"]
    np.testing.assert_allclose(square[12:36], wide, atol=0.3)  # the aperture grows up and down
    anamorphic = fexel.render(stage, camera="Near", width=24, height=24, pixel_aspect=2.0, aovs=("alpha",))["alpha"]
    np.testing.assert_allclose(anamorphic.mean(), wide.mean(), atol=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"aovs": ("color", "colour")}, "unknown AOV 'colour'"),
        ({"aovs": "color"}, "expected a sequence"),
        ({"aovs": ()}, "expected a sequence"),
        ({"camera": "Nope"}, "/World/Cameras/Near"),
        ({"width": -3}, "-3"),
        ({"height": 0}, "height"),
        ({"samples": -1}, "samples"),
        ({"conform_policy": "stretch"}, "expandAperture"),
        ({"height": 4, "pixel_aspect": 0.0}, "pixel aspect"),
        ({"texture_memory_mb": -1}, "texture memory"),
    ],
)
def test_bad_arguments_are_told_in_one_line(tmp_path, options, message):
    two_camera_stage(tmp_path / "shot.usda")
    with pytest.raises(FexelError, match=message) as error:
        fexel.render(tmp_path / "shot.usda", **options)
    assert "\n" not in str(error.value)


def test_missing_stage_is_named():
    with pytest.raises(FexelError, match=r"no/such\.usda"):
        fexel.render("no/such.usda")


def test_image_that_does_not_fit_into_memory_is_one_line(renderer, monkeypatch):
    def full(*_shape):
        raise MemoryError

    monkeypatch.setattr(frame.np, "empty", full)
    with pytest.raises(FexelError, match="not enough memory for 60000 x 60000 pixels of color"):
        renderer.draw(scene(draw(quad())), settings(60000, 60000))


def test_a_frame_that_fails_does_not_spoil_the_next(renderer, monkeypatch):
    shown = scene(draw(quad(9), emissiveColor=(1.0, 0.5, 0.25), opacity=0.5))
    before = renderer.draw(shown, settings(4, 4))["color"]

    def interrupted(*_arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("fexel.renderer.draw_state.DrawState._draw_mesh", interrupted)
        with pytest.raises(KeyboardInterrupt):
            renderer.draw(shown, settings(4, 4))
    assert np.array_equal(renderer.draw(shown, settings(4, 4))["color"], before)


def test_options_of_a_stage_may_change_from_call_to_call(renderer, tmp_path):
    two_camera_stage(tmp_path / "shot.usda")
    stage = Usd.Stage.Open(str(tmp_path / "shot.usda"))
    full = renderer.render(stage, camera="Near", width=32, aovs=("alpha",))["alpha"]
    with pytest.warns(match="nothing to draw"):
        masked = renderer.render(stage, camera="Near", width=32, aovs=("alpha",), mask=("/World/Cameras",))["alpha"]
    again = renderer.render(stage, camera="Near", width=32, aovs=("alpha",))["alpha"]
    assert full.any() and not masked.any() and np.array_equal(full, again)
