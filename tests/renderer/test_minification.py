"""Contrast, brightness and attenuation of TextureMinificationAPI on rendered frames, against NumPy."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdShade

from fexel.errors import FexelError, FexelWarning
from fexel.filters.minification import Minification
from fexel.renderer import Renderer
from fexel.schema.minification import TextureMinificationAPI
from stages import textured_quad, write_image

BLACK = {"diffuseColor": (0.0, 0.0, 0.0), "useSpecularWorkflow": 1}
FLAT = {"camera_light": False, "samples": 1}
TEXTURE = "/World/Material/emissiveColor"
EYE = np.array([0.3, -0.2, 5.0])
TYPES = {"contrast": "Float", "brightness": "Float", "attenuationDistance": "Float", "attenuationColor": "Color3f"}


def apply(stage, path=TEXTURE, **values):
    """The API on a texture, with values or, by time, dicts of values."""
    api = TextureMinificationAPI.Apply(stage.GetPrimAtPath(path))
    for name, value in values.items():
        attribute = api.GetPrim().GetAttribute(f"minification:{name}")
        for time, sample in (value if isinstance(value, dict) else {None: value}).items():
            sample = Gf.Vec3f(*sample) if isinstance(sample, tuple) else sample
            attribute.Set(sample) if time is None else attribute.Set(sample, time)
    return stage


def tilted(tmp_path, rng, *, perspective=True, alpha=True, raw=False, name="quad"):
    """A sloping quad of random texels, seen whole; emission alone, opacity from the image's alpha."""
    pixels = rng.integers(40, 256, (16, 16, 4), dtype=np.uint8)
    file = f"./{write_image(tmp_path / f'{name}.png', pixels).name}"
    more = {"sourceColorSpace": "raw"} if raw else {}
    textures = {"emissiveColor": (file, "rgb", more)}
    stage = textured_quad(tmp_path / f"{name}.usda", textures, **BLACK)
    if alpha:
        surface = UsdShade.Shader(stage.GetPrimAtPath("/World/Material/Surface"))
        texture = UsdShade.Shader(stage.GetPrimAtPath(TEXTURE))
        source = texture.CreateOutput("a", Sdf.ValueTypeNames.Float)
        surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(source)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Quad"))
    mesh.GetPointsAttr().Set([Gf.Vec3f(x, y, 1.5 * x) for x, y in [(-1, -1), (1, -1), (1, 1), (-1, 1)]])
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetPrim().GetAttribute("xformOp:translate").Set(Gf.Vec3d(*map(float, EYE)))
    if perspective:
        camera.GetProjectionAttr().Set("perspective")
        camera.CreateFocalLengthAttr(40.0)
    return stage


def frame(renderer, stage, **options):
    images = renderer.render(stage, width=48, height=40, aovs=("color", "position", "primId"), **FLAT, **options)
    seen = images["primId"][..., 0] >= 0
    assert seen.mean() > 0.2
    return images["color"][seen].astype(np.float64), images["position"][seen].astype(np.float64)


def expected(color, distance, asked):
    """Premultiplied: mix(haze, s c + o, exp(-d / D)), alpha untouched."""
    alpha = color[:, 3:]
    toned = asked.contrast * color[:, :3] + asked.brightness * alpha
    left = np.exp(-distance / asked.attenuation_distance)[:, None]
    return np.concatenate([left * toned + (1 - left) * np.array(asked.attenuation_color) * alpha, alpha], axis=1)


ASKED = [
    Minification(contrast=0.5),
    Minification(contrast=1.75, brightness=-0.125),
    Minification(contrast=-1.0, brightness=1.0),
    Minification(brightness=0.25),
    Minification(attenuation_distance=4.0),
    Minification(contrast=0.75, brightness=0.125, attenuation_distance=2.5, attenuation_color=(0.25, 0.5, 2.0)),
]


def authored(asked):
    return {
        "contrast": asked.contrast,
        "brightness": asked.brightness,
        "attenuationDistance": asked.attenuation_distance,
        "attenuationColor": asked.attenuation_color,
    }


@pytest.mark.parametrize("asked", ASKED, ids=range(len(ASKED)))
@pytest.mark.parametrize("perspective", [True, False], ids=["perspective", "orthographic"])
def test_texture_is_toned_and_fades_with_its_distance(renderer, tmp_path, rng, asked, perspective):
    stage = tilted(tmp_path, rng, perspective=perspective)
    plain, position = frame(renderer, stage)
    assert np.unique(plain[:, 3]).size > 10  # alpha varies
    relative = position - EYE
    distance = np.linalg.norm(relative, axis=1) if perspective else -relative[:, 2]
    assert np.ptp(distance) > 0.7
    color, _ = frame(renderer, apply(stage, **authored(asked)))
    np.testing.assert_allclose(color, expected(plain, distance, asked), rtol=2e-4, atol=2e-5)


def test_distance_is_measured_along_the_ray_and_to_the_plane_of_an_orthographic_camera(renderer, tmp_path):
    file = write_image(tmp_path / "white.png", np.full((4, 4, 3), 255, np.uint8))
    textures = {"emissiveColor": (f"./{file.name}", "rgb", {})}
    stage = apply(
        textured_quad(tmp_path / "quad.usda", textures, **BLACK),
        attenuationDistance=5.0,
        attenuationColor=(0.0, 0.0, 0.0),
    )
    across = (np.arange(32) + 0.5) / 16 - 1  # of the quad, 5 units in front of the camera
    color = renderer.render(stage, width=32, height=32, **FLAT)["color"][..., 0]
    np.testing.assert_allclose(color, np.exp(-1.0), rtol=1e-4)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetProjectionAttr().Set("perspective")
    camera.GetFocalLengthAttr().Set(50.0)  # the aperture is 20: the quad fills the picture
    color = renderer.render(stage, width=32, height=32, **FLAT)["color"][..., 0]
    distance = np.sqrt(25 + across[:, None] ** 2 + across**2)
    np.testing.assert_allclose(color, np.exp(-distance / 5.0), rtol=1e-4)


def test_raw_data_are_adjusted_as_they_are_used(renderer, tmp_path, rng):
    asked = Minification(contrast=0.5, brightness=0.25, attenuation_distance=8.0)
    stage = tilted(tmp_path, rng, raw=True, alpha=False)
    plain, position = frame(renderer, stage)
    color, _ = frame(renderer, apply(stage, **authored(asked)))
    distance = np.linalg.norm(position - EYE, axis=1)
    np.testing.assert_allclose(color, expected(plain, distance, asked), rtol=2e-4, atol=2e-5)


def test_adjustment_comes_after_scale_and_bias(renderer, tmp_path):
    file = write_image(tmp_path / "grey.png", np.full((4, 4, 3), 51, np.uint8))
    more = {"sourceColorSpace": "raw", "scale": (2, 2, 2, 1), "bias": (0.1, 0.1, 0.1, 0)}
    stage = textured_quad(tmp_path / "quad.usda", {"emissiveColor": (f"./{file.name}", "rgb", more)}, **BLACK)
    color = renderer.render(apply(stage, contrast=0.5, brightness=0.25), width=4, **FLAT)["color"]
    np.testing.assert_allclose(color[..., :3], 0.5 * (2 * 0.2 + 0.1) + 0.25, rtol=2e-3)


def test_only_the_slot_that_asks_for_it_is_adjusted(renderer, tmp_path):
    file = f"./{write_image(tmp_path / 'grey.png', np.full((4, 4, 3), 128, np.uint8)).name}"
    raw = {"sourceColorSpace": "raw"}
    textures = {"emissiveColor": (file, "rgb", raw), "opacity": (file, "r", raw)}
    stage = textured_quad(tmp_path / "quad.usda", textures, **BLACK)
    plain = renderer.render(stage, width=4, **FLAT)["color"]
    apply(stage, "/World/Material/opacity", contrast=0.5)
    color = renderer.render(stage, width=4, **FLAT)["color"]
    np.testing.assert_allclose(color, 0.5 * plain, rtol=1e-3)  # premultiplied: opacity alone is halved
    apply(stage, contrast=0.5, brightness=0.25)
    color = renderer.render(stage, width=4, **FLAT)["color"]
    np.testing.assert_allclose(color[..., :3], 0.25 * plain[..., :3] + 0.25 * color[..., 3:], rtol=1e-3)


def test_deep_zoom_fades_as_the_same_place_seen_whole(renderer, tmp_path):
    file = write_image(tmp_path / "white.png", np.full((4, 4, 3), 255, np.uint8))
    textures = {"emissiveColor": (f"./{file.name}", "rgb", {})}
    stage = textured_quad(tmp_path / "quad.usda", textures, **BLACK)
    camera = UsdGeom.Camera(stage.GetPrimAtPath("/World/Camera"))
    camera.GetProjectionAttr().Set("perspective")
    camera.CreateFocalLengthAttr(50.0)
    camera.GetHorizontalApertureAttr().Set(1e-5)
    camera.GetVerticalApertureAttr().Set(1e-5)
    apply(stage, contrast=0.5, attenuationDistance=5.0, attenuationColor=(0.0, 1.0, 0.0))
    with Renderer() as own:
        color = own.render(stage, width=16, height=16, **FLAT)["color"]
        assert own.stats()["rebasedDraws"] == 1
    left = np.exp(-1.0)
    np.testing.assert_allclose(color[..., 0], 0.5 * left, rtol=1e-4)
    np.testing.assert_allclose(color[..., 1], 0.5 * left + 1 - left, rtol=1e-4)


def test_animated_look_follows_the_time_and_compiles_nothing_anew(tmp_path):
    file = write_image(tmp_path / "white.png", np.full((4, 4, 3), 255, np.uint8))
    stage = textured_quad(tmp_path / "quad.usda", {"emissiveColor": (f"./{file.name}", "rgb", {})}, **BLACK)
    apply(stage, contrast={1: 0.25, 3: 0.75}, attenuationDistance={1: 5.0, 3: 10.0}, attenuationColor=(0.0, 0.0, 0.0))
    with Renderer() as renderer:
        shown, programs = [], []
        for time in (1.0, 2.0, 3.0):
            shown.append(renderer.render(stage, width=4, time=time, **FLAT)["color"][0, 0, 0])
            programs.append(renderer.stats()["programs"])
    np.testing.assert_allclose(
        shown, np.array([0.25, 0.5, 0.75]) * np.exp(-5.0 / np.array([5.0, 7.5, 10.0])), rtol=1e-4
    )
    assert programs[0] == programs[2]


def test_stage_without_the_api_compiles_the_programs_it_did_before(tmp_path, rng, monkeypatch):
    """Defaults cost nothing: the same defines, none of them the API's, so the same program."""
    from fexel.renderer import program as program_module

    texts = []
    original = program_module.load_shader

    def load(*arguments):
        source = original(*arguments)
        texts.append(source.text)
        return source

    monkeypatch.setattr(program_module, "load_shader", load)
    stage = tilted(tmp_path, rng)
    with Renderer() as renderer:
        before = renderer.render(stage, width=48, height=40, **FLAT)["color"]
        count = len(texts)
        apply(stage, filter="anisotropic", contrast=1.0, brightness=0.0, attenuationDistance=float("inf"))
        after = renderer.render(stage, width=48, height=40, **FLAT)["color"]
        assert len(texts) == count and renderer.stats()["programs"] == 1
    np.testing.assert_array_equal(before, after)
    for text in texts:
        header = text[: text.index("#line ")]
        assert "TEXTURE_COUNT" in header or "TEXTURE" not in header
        assert not any(name in header for name in ("TEXTURE_TONED", "TEXTURE_ATTENUATED", "LOOKUP_COUNTS"))


@pytest.mark.parametrize(
    ("name", "value", "fault"),
    [
        ("contrast", float("nan"), "is nan, expected a finite number; 1 is used"),
        ("contrast", float("inf"), "is inf, expected a finite number; 1 is used"),
        ("brightness", -float("inf"), "is -inf, expected a finite number; 0 is used"),
        ("attenuationDistance", -2.0, "is -2, expected more than 0; nothing is attenuated"),
        ("attenuationDistance", 0.0, "is 0, expected more than 0; nothing is attenuated"),
        ("attenuationDistance", float("nan"), "is nan, expected more than 0; nothing is attenuated"),
        ("attenuationColor", (0.5, -1.0, 0.5), "is (0.5, -1, 0.5), expected finite values from 0; white is used"),
        (
            "filter",
            "trilinear",
            "is 'trilinear', expected one of mipmap, anisotropic, ripmap, fipmap; anisotropic is used",
        ),
    ],
)
def test_value_that_cannot_be_used_warns_once_and_is_left_out(tmp_path, rng, name, value, fault):
    stage = tilted(tmp_path, rng)
    with Renderer() as renderer:
        before, _ = frame(renderer, stage)
        apply(stage, **{name: value})
        apply(stage, contrast={1: 1.0, 2: 1.0}) if name != "contrast" else None  # varies: read at each time
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            after, _ = frame(renderer, stage, time=1.0)
        assert [str(one.message) for one in caught if one.category is FexelWarning] == [
            f"{TEXTURE}.minification:{name}: {fault}"
        ]
        with warnings.catch_warnings():
            warnings.simplefilter("error" if name != "filter" else "ignore")
            frame(renderer, stage, time=2.0)
    np.testing.assert_array_equal(before, after)


def test_tiny_distance_leaves_the_colour_alone_and_no_nan(renderer, tmp_path, rng):
    stage = apply(tilted(tmp_path, rng, alpha=False), attenuationDistance=1e-42, attenuationColor=(0.25, 0.5, 0.75))
    color, _ = frame(renderer, stage)
    np.testing.assert_allclose(color, np.broadcast_to([0.25, 0.5, 0.75, 1.0], color.shape), rtol=1e-6)


def test_attributes_without_the_api_are_left_out_and_said_once(renderer, tmp_path, rng):
    stage = tilted(tmp_path, rng)
    before, _ = frame(renderer, stage)
    prim = stage.GetPrimAtPath(TEXTURE)
    prim.CreateAttribute("minification:contrast", Sdf.ValueTypeNames.Float).Set(0.0)
    with pytest.warns(FexelWarning) as caught:
        after, _ = frame(renderer, stage)
    (message,) = [str(one.message) for one in caught]
    assert message == (
        f"{TEXTURE}.minification:contrast: is authored, but TextureMinificationAPI is not applied to the prim; "
        "it is left out"
    )
    np.testing.assert_array_equal(before, after)


def test_unknown_filter_of_the_renderer_lists_the_valid_ones():
    with pytest.raises(
        FexelError, match="filter: 'cubic', expected one of mipmap, anisotropic, ripmap, fipmap, ewa, auto"
    ):
        Renderer(filter="cubic")


def test_unknown_kernel_of_the_renderer_lists_the_valid_ones():
    with pytest.raises(FexelError, match="filter kernel: 'tent', expected one of box, gauss"):
        Renderer(filter_kernel="tent")


@pytest.mark.parametrize("anisotropy", [0, 17])
def test_anisotropy_outside_of_its_range_is_an_error(anisotropy):
    with pytest.raises(FexelError, match=f"anisotropy: {anisotropy}, expected 1 to 16"):
        Renderer(anisotropy=anisotropy)
