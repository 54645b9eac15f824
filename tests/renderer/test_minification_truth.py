"""A texture alone on a quad, drawn with every filter, against what its pixels cover; of normal maps the directions."""

from __future__ import annotations

import numpy as np
import pytest
from pxr import Gf, UsdGeom

from fexel.filters import FILTERS
from fexel.renderer import Renderer
from fexel.schema.minification import TextureMinificationAPI
from stages import textured_quad, write_image

BLACK = {"diffuseColor": (0.0, 0.0, 0.0), "useSpecularWorkflow": 1}
PIXELS = 24
SIZE = (96, 64)  # of the image; width, height
DECODED = {"scale": (2.0, 2.0, 2.0, 1.0), "bias": (-1.0, -1.0, -1.0, 0.0)}


def view(elevation, azimuth):
    """(2, 2) texels, y down, per pixel: 1.25 across."""
    turn = np.array([[np.cos(azimuth), -np.sin(azimuth)], [np.sin(azimuth), np.cos(azimuth)]])
    return turn @ np.diag([1.25 / np.sin(elevation), 1.25])


def stage_of(path, file, jacobian, filter=None, **inputs):
    """The picture shows texels `jacobian` (x, y) of the repeated image around its middle."""
    inputs = {"wrapS": "repeat", "wrapT": "repeat", **inputs}
    stage = textured_quad(path, {"emissiveColor": (f"./{file.name}", "rgb", inputs)}, **BLACK)
    corners = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]]) * PIXELS  # y down
    texels = corners @ jacobian.T + np.array(SIZE) / 2
    st = [Gf.Vec2f(x / SIZE[0], 1 - y / SIZE[1]) for x, y in texels]
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Quad")).GetPrimvar("st").Set(st)
    if filter:
        api = TextureMinificationAPI.Apply(stage.GetPrimAtPath("/World/Material/emissiveColor"))
        api.GetPrim().GetAttribute("minification:filter").Set(filter)
    return stage


def truth(image, jacobian, is_gauss=False, side=40):
    """(PIXELS, PIXELS, C) means of the bilinear texture over pixels, or weighted by a Gaussian of half a pixel."""
    reach = 2.0 if is_gauss else 0.5
    offset = ((np.arange(side) + 0.5) / side * 2 - 1) * reach
    weight = np.exp(-2 * offset**2) if is_gauss else np.ones(side)
    weight = np.outer(weight, weight).ravel() / weight.sum() ** 2
    offsets = np.stack(np.meshgrid(offset, offset), -1).reshape(-1, 2)
    pixel = np.stack(np.meshgrid(*[np.arange(PIXELS) + 0.5 - PIXELS / 2] * 2), -1)
    found = np.zeros((PIXELS, PIXELS, image.shape[2]))
    for one, share in zip(offsets, weight, strict=True):
        x, y = np.moveaxis((pixel + one) @ jacobian.T + np.array(SIZE) / 2 - 0.5, -1, 0)
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            part = np.abs(1 - dx - (x - column)) * np.abs(1 - dy - (y - row))
            found += share * part[..., None] * image[(row + dy) % SIZE[1], (column + dx) % SIZE[0]]
    return found


def blocks(rng, size=4):
    return rng.random((SIZE[1] // size, SIZE[0] // size, 3)).repeat(size, 0).repeat(size, 1)


def drawn(stage, **options):
    with Renderer(**options) as renderer:
        return renderer.render(stage, width=PIXELS, height=PIXELS)["color"][..., :3].astype(np.float64)


FRONT, GRAZING = view(np.pi / 2, 0.35), view(np.radians(8), 0.35)


@pytest.mark.parametrize(
    ("filter", "jacobian", "least"),
    [
        *((filter, FRONT, 27.0) for filter in FILTERS),
        ("mipmap", GRAZING, 15.0),
        ("ripmap", GRAZING, 15.0),
        *((filter, GRAZING, 35.0) for filter in ("anisotropic", "fipmap", "ewa", "auto")),
        ("ripmap", view(np.radians(8), 0.0), 30.0),
    ],
)
def test_texture_alone_shows_what_its_pixels_cover(tmp_path, rng, filter, jacobian, least):
    image = blocks(rng)
    file = write_image(tmp_path / "blocks.png", (image * 65535 + 0.5).astype(np.uint16), "uint16")
    found = drawn(stage_of(tmp_path / "quad.usda", file, jacobian), filter=filter, anisotropy=16)
    wanted = truth(image, jacobian, filter == "ewa")
    error = -10 * np.log10(np.mean((found - wanted) ** 2))
    assert error > least
    assert np.corrcoef(found.ravel(), wanted.ravel())[0, 1] > (0.5 if least < 20 else 0.95)


def bumps(rng):
    vectors = rng.normal(size=(SIZE[1] // 4, SIZE[0] // 4, 3)).repeat(4, 0).repeat(4, 1) * [0.6, 0.6, 1.0]
    vectors[..., 2] = np.abs(vectors[..., 2]) + 0.2
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def off_degrees(found, wanted):
    cosine = (found * wanted).sum(axis=-1) / np.linalg.norm(found, axis=-1) / np.linalg.norm(wanted, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("space", ["raw", "auto"])
@pytest.mark.parametrize("filter", ["mipmap", "anisotropic", "ripmap", "fipmap"])
@pytest.mark.parametrize("jacobian", [FRONT, GRAZING, 0.4 * FRONT])
def test_filtered_normals_are_as_long_as_one(renderer, tmp_path, rng, filter, space, jacobian):
    file = write_image(tmp_path / "normals.png", ((bumps(rng) + 1) / 2 * 65535 + 0.5).astype(np.uint16), "uint16")
    stage = stage_of(tmp_path / "quad.usda", file, jacobian, filter, sourceColorSpace=space, **DECODED)
    found = renderer.render(stage, width=PIXELS, height=PIXELS)["color"][..., :3]
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=2e-3)


def test_renormalising_turns_no_normal(tmp_path, rng):
    vectors = bumps(rng)
    file = write_image(tmp_path / "normals.png", ((vectors + 1) / 2 * 65535 + 0.5).astype(np.uint16), "uint16")
    jacobian = view(np.radians(3), 0.46)
    stage = stage_of(tmp_path / "quad.usda", file, jacobian, sourceColorSpace="raw", **DECODED)
    wanted = truth(vectors, jacobian, side=80)
    off = {
        filter: off_degrees(drawn(stage, filter=filter, anisotropy=16), wanted)
        for filter in ("mipmap", "anisotropic", "fipmap")
    }
    assert off["anisotropic"].mean() < 0.6
    assert off["fipmap"].mean() < 1.2 and off["fipmap"].max() < 5.0
    assert off["mipmap"].mean() > 5.0


def test_normal_map_without_the_api_and_colours_with_it_are_as_long_as_their_means(renderer, tmp_path, rng):
    image = (bumps(rng) + 1) / 2
    files = [write_image(tmp_path / "normals.png", (image * 65535 + 0.5).astype(np.uint16), "uint16")]
    files.append(write_image(tmp_path / "colours.png", (image * 255 + 0.5).astype(np.uint8)))
    for file, filter in ((files[0], None), (files[1], "mipmap")):
        stage = stage_of(tmp_path / f"{file.stem}.usda", file, GRAZING, filter, sourceColorSpace="auto", **DECODED)
        found = renderer.render(stage, width=PIXELS, height=PIXELS)["color"][..., :3]
        assert np.linalg.norm(found, axis=-1).mean() < 0.9
