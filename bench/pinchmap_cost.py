"""Cost of a pinchmap lookup over one plain mip-mapped lookup, 1024 x 1024 pixels, in turns within one run.

A pinchmap of 64 x 64 texels with random lines and an sRGB signal twice as fine, anti-aliased, through the renderer's
own path. The plain lookup is GL's trilinear filter on a texture of the signal's format, between levels 0 and 1 so that
it blends two, as for zipmaps; beside it stands the same filter on the very signal, magnified, where it reads one level.
Lit, whole frames are compared: a quad under six lights, with the pinchmap or with a UsdUVTexture as large as the frame.
Times are CPU times of the process: the software rasteriser's threads count, other processes do not.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.cost_target import CostTarget, cpu_times
from bench.harness import Row
from bench.pinchmap_texture import pinchmap_stage, random_pinchmap, save_texels, two_sides
from bench.zipmap_stage import Patch, quad, save, zipmap_stage, zipmap_texture
from fexel.renderer.aov import checked_aovs
from fexel.renderer.api import Renderer
from fexel.renderer.context import GLContext
from fexel.renderer.frame import FrameSettings
from fexel.scene.model import Camera, Draw, Light, Material, Scene, Texture, TextureInput
from fexel.textures.pinchmap_encoding import encode_texels

NAME = "pinchmap lookup cost"
_PIXELS = 1024
_SIZE = 64
_LOD = 0.5
_LIGHTS = ((-1, 1), (1, 1), (-1, -1), (1, -1), (0, 1.5), (0, -1.5))


def pinchmapped(folder: Path, size: int = _SIZE, **inputs: object) -> Texture:
    """A random pinchmapped texture, as the renderer gets it."""
    rng = np.random.default_rng(20050904)
    pinchmap, mask = random_pinchmap(rng, (size, size))
    files = [folder / f"{name}{size}.png" for name in ("pinchmap", "signal")]
    save_texels(files[0], encode_texels(pinchmap))
    save_texels(files[1], two_sides(rng, mask, 1))
    inputs = {"sourceColorSpace": "sRGB", "wrapS": "clamp", "wrapT": "clamp"} | inputs
    stage = pinchmap_stage(str(files[1]), str(files[0]), **inputs)
    return zipmap_texture(stage, "/Pinchmap")


def unlit_ratios(gl, folder: Path, repeats: int) -> dict[str, tuple[float, float, float]]:
    """By setting: CPU time over the plain lookup's and over the magnified one's, and the spread of the first."""
    target = CostTarget(gl, _PIXELS)
    frames = {
        "plain": target.plain(int(_PIXELS * 2**_LOD)),
        "magnified": target.plain(2 * _SIZE),
        "anti-aliased": target.textured(pinchmapped(folder)),
        "hard edges": target.textured(pinchmapped(folder, antialias=0.0)),
        "solid lines": target.textured(pinchmapped(folder, lineWidth=0.3)),
        "tiled": target.textured(pinchmapped(folder, wrapS="repeat", wrapT="repeat"), 2.5),
        "tiled, between two mip levels": target.textured(
            pinchmapped(folder, wrapS="repeat", wrapT="repeat"), 8 * 2**_LOD
        ),
        "wrap black, as where none is authored": target.textured(pinchmapped(folder, wrapS="black", wrapT="black")),
        "8 x 8 texels, by four fetches": target.textured(pinchmapped(folder, 8)),
    }
    times = cpu_times(frames, repeats)
    target.release()
    ratios = {}
    for name in list(frames)[2:]:
        pairs = times[name] / times["plain"]
        low, high = np.percentile(pairs, [25, 75])
        ratios[name] = (float(np.median(pairs)), float(np.median(times[name] / times["magnified"])), (high - low) / 2)
    return ratios


def lit_ratio(folder: Path, repeats: int) -> tuple[float, float]:
    """CPU time of a frame with a pinchmap over that with a plain texture, six lights, and half its spread."""
    rng = np.random.default_rng(1)
    texels = rng.random((1448, 1448, 4), np.float32)
    texels[..., 3] = 1.0
    file = save(folder / "plain.tif", texels, "uint8", "sRGB", 20)
    textures = {
        "pinchmap": pinchmapped(folder),
        "plain": zipmap_texture(zipmap_stage(Patch(file, np.eye(3), color_space="sRGB"))),
    }
    settings = FrameSettings(_PIXELS, _PIXELS, checked_aovs(("color",)), samples=1, camera_light=False)
    renderers = {name: Renderer(anisotropy=1) for name in textures}  # each keeps its own texture loaded
    times = cpu_times({name: _lit_frame(renderers[name], textures[name], settings) for name in textures}, repeats)
    for renderer in renderers.values():
        renderer.close()
    pairs = times["pinchmap"] / times["plain"]
    low, high = np.percentile(pairs, [25, 75])
    return float(np.median(pairs)), float(high - low) / 2


def _lit_frame(renderer: Renderer, texture: Texture, settings: FrameSettings) -> Callable[[], object]:
    material = Material("/Material", {"diffuseColor": TextureInput(texture, "rgb"), "roughness": 0.4})
    mesh = quad().mesh
    draw = Draw(mesh, 0, len(mesh.triangles), np.eye(4), material, mesh.path, 0)
    lights = []
    for x, y in _LIGHTS:
        matrix = np.eye(4)
        matrix[3, :3] = x, y, 2.0
        lights.append(Light(f"/Light{x}{y}".replace(".", "_"), "sphere", (3.0, 3.0, 3.0), matrix))
    matrix = np.eye(4)
    matrix[3, :3] = -0.5, -0.5, -5.0
    projection = np.diag([2.0, 2.0, -2 / 9, 1.0])
    projection[3, 2] = -11 / 9
    camera = Camera("/Camera", matrix, projection, 1.0, 10.0, 1.0)
    scene = Scene((draw,), tuple(lights), camera, (mesh.path,))
    return lambda: renderer.draw(scene, settings)


def rows(quick: bool) -> Iterator[Row]:
    """Ratios to one plain lookup."""
    repeats = 7 if quick else 25
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with GLContext() as gl:
            ratios = unlit_ratios(gl, folder, repeats)
        for setting, (ratio, magnified, spread) in ratios.items():
            asked = setting == "anti-aliased"
            yield Row(
                measure="pinchmap lookup cost",
                setting=setting,
                value=ratio,
                unit="plain mip-mapped lookups",
                target=2.0 if asked else None,
                comparison="<=" if asked else None,
                reference="2.1 to 2.5" if asked else "",
                spread=spread,
                samples=repeats,
                note=f"{magnified:.2f} lookups of the signal alone",
            )
        ratio, spread = lit_ratio(folder, repeats)
        yield Row(
            measure="cost of a frame lit by six lights, pinchmap over plain texture",
            setting="anti-aliased",
            value=ratio,
            unit="ratio",
            target=1.5,
            comparison="<=",
            spread=spread,
            samples=repeats,
        )
