"""Cost of a zipmap lookup over one plain mip-mapped lookup, 1024 x 1024 pixels, unlit, in turns within one run.

The plain lookup is GL's own trilinear filter on a texture of the same format, at the same level of detail (between
levels 0 and 1, so that both blend two levels). Patches cover the whole view, each a little shifted, with masks as
authored (opaque interior, soft rim of an eighth) or, as the worst case, translucent all over.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bench.harness import Row, time_alternately
from bench.zipmap_stage import Patch, compiled_view, front_view, quad, save, zipmap_stage, zipmap_texture
from fexel import homography
from fexel.renderer.context import GLContext
from fexel.renderer.program import ProgramCache
from fexel.textures.system import TextureSystem

NAME = "zipmap lookup cost"
_PIXELS = 1024
_LOD = 0.5
_TARGETS = {1: 2.0, 4: 4.5, 6: 6.0, 30: 12.0}
_REFERENCE = {1: "best of five plain ways 2.1", 4: "4.8", 6: "6.5", 30: "18"}
_SRGB8_ALPHA8 = 0x8C43


def _image(rng: np.random.Generator, size: int, mask: str) -> np.ndarray:
    """(size, size, 4) linear, premultiplied noise; `mask` is ``opaque``, ``authored`` or ``translucent``."""
    texels = rng.random((size, size, 4), np.float32)
    place = (np.arange(size) + 0.5) / size
    edge = np.minimum(place, 1 - place)
    soft = np.clip(8 * np.minimum(edge[:, None], edge[None, :]), 0, 1)
    texels[..., 3] = {"opaque": 1.0, "authored": soft, "translucent": 0.4}[mask]
    texels[..., :3] *= texels[..., 3:]
    return texels


def _file(path: Path, rng: np.random.Generator, size: int, mask: str) -> str:
    return str(path) if path.exists() else save(path, _image(rng, size, mask), "uint8", "sRGB", 20)


def covering_patches(folder: Path, count: int, mask: str) -> Patch:
    """A root and `count` patches over the whole view, each shifted and scaled a little so that rims cross the view."""
    rng = np.random.default_rng(20100504)
    size = int(_PIXELS * 2**_LOD)
    root = _file(folder / "root.tif", rng, size, "opaque")
    file = _file(folder / f"{mask}.tif", rng, size, mask)
    patches = []
    for _ in range(count):
        shift, grow = rng.uniform(-0.05, 0.05, 2), rng.uniform(1.0, 1.1)
        about = homography.translate(-0.5, -0.5) @ homography.scale(1 / grow, 1 / grow)
        patches.append(Patch(file, about @ homography.translate(*(0.5 + shift)), color_space="sRGB"))
    return Patch(root, np.eye(3), children=tuple(patches), color_space="sRGB")


def scattered_patches(folder: Path, count: int) -> Patch:
    """`count` patches on a jittered grid that cover half of the root, opaque with a soft rim."""
    rng = np.random.default_rng(20100504)
    side = int(np.ceil(np.sqrt(count)))
    width = np.sqrt(0.5) / side
    texels = int(np.clip(2 ** np.ceil(np.log2(width * _PIXELS * 2**_LOD)), 8, 512))
    size = int(_PIXELS * 2**_LOD)
    root = _file(folder / "root.tif", rng, size, "opaque")
    files = [_file(folder / f"scatter{texels}-{n}.tif", rng, texels, "authored") for n in range(8)]
    patches = []
    for number in range(count):
        corner = (np.array([number % side, number // side]) + rng.uniform(0, 1 - np.sqrt(0.5), 2)) / side
        matrix = homography.translate(*-corner) @ homography.scale(1 / width, 1 / width)
        patches.append(Patch(files[number % 8], matrix, color_space="sRGB"))
    return Patch(root, np.eye(3), children=tuple(patches), color_space="sRGB")


class _Harness:
    """Draws into one 1024 x 1024 target; `frame` gives a closure that draws a zipmap and waits for it."""

    def __init__(self, gl) -> None:
        self.gl = gl
        self.target = gl.framebuffer([gl.renderbuffer((_PIXELS, _PIXELS), 4, dtype="f2")])
        self.systems: list[TextureSystem] = []
        self._programs = ProgramCache(gl)

    def plain(self) -> Callable[[], None]:
        """One mip-mapped lookup."""
        size = int(_PIXELS * 2**_LOD)
        texels = (np.random.default_rng(1).random((size, size, 4)) * 255).astype(np.uint8)
        texture = self.gl.texture((size, size), 4, texels.tobytes(), internal_format=_SRGB8_ALPHA8)
        texture.build_mipmaps()
        texture.filter = (self.gl.LINEAR_MIPMAP_LINEAR, self.gl.LINEAR)
        program = self._programs.get("texture_view.vert", "texture_plain.frag")
        draw = compiled_view(self.gl, program, quad(), front_view((0, 0), (1, 1), _PIXELS, _PIXELS))

        def frame() -> None:
            texture.use(0)
            program["plain"] = 0
            self._draw(draw)

        return frame

    def zipmap(self, root: Patch, anisotropy: float = 1.0) -> Callable[[], None]:
        """A zipmap seen from the front."""
        system = TextureSystem(self.gl, anisotropy=anisotropy)
        self.systems.append(system)
        view = front_view((0, 0), (1, 1), _PIXELS, _PIXELS)
        program, binding, draw = compiled_view(
            self.gl, self._programs, quad(), view, (zipmap_texture(zipmap_stage(root)), system)
        )

        def frame() -> None:
            binding.apply(program)
            self._draw(draw)

        return frame

    def _draw(self, draw: Callable[[], None]) -> None:
        self.target.use()
        draw()
        self.gl.finish()


def cost_ratios(gl, scenes: dict[str, Patch], repeats: int) -> dict[str, tuple[float, float]]:
    """Median time of each scene over that of the plain lookup, and half the spread of the ratio."""
    harness = _Harness(gl)
    frames = {"plain": harness.plain()} | {name: harness.zipmap(root) for name, root in scenes.items()}
    times = time_alternately(frames, repeats=repeats)
    plain = times["plain"].median_s
    result = {name: (times[name].median_s / plain, times[name].spread_s / plain) for name in scenes}
    for system in harness.systems:
        system.release()
    return result


def rows(quick: bool) -> Iterator[Row]:
    """Ratios to one plain lookup."""
    repeats = 5 if quick else 15
    with GLContext() as gl, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for mask in ("authored", "translucent"):
            scenes = {str(n): covering_patches(folder, n, mask) for n in _TARGETS}
            for count, (ratio, spread) in zip(_TARGETS, cost_ratios(gl, scenes, repeats).values(), strict=True):
                yield Row(
                    measure=f"zipmap lookup cost, {mask} masks",
                    setting=f"root and {count} patches over the whole view",
                    value=ratio,
                    unit="plain mip-mapped lookups",
                    target=_TARGETS[count],
                    comparison="<=",
                    reference=_REFERENCE[count],
                    spread=spread,
                    samples=repeats,
                    note="worst case" if mask == "translucent" else "opaque interior, soft rim",
                )
        yield from _scattered_rows(gl, folder, repeats)


def _scattered_rows(gl, folder: Path, repeats: int) -> Iterator[Row]:
    ratios = cost_ratios(gl, {str(n): scattered_patches(folder, n) for n in (30, 3000, 10_000)}, repeats)
    for count in (30, 3000, 10_000):
        ratio, spread = ratios[str(count)]
        yield Row(
            measure="zipmap lookup cost, half the root covered",
            setting=f"{count} patches",
            value=ratio,
            unit="plain mip-mapped lookups",
            target=9.0 if count > 30 else None,
            comparison="<=" if count > 30 else None,
            reference="240 for 300 in a loop; 11 for 3000 with a grid",
            spread=spread,
            samples=repeats,
        )
        if count > 30:
            yield Row(
                measure="zipmap lookup cost over that of 30 patches, half the root covered",
                setting=f"{count} patches",
                value=ratio / ratios["30"][0],
                unit="ratio",
                target=1.3,
                comparison="<=",
                samples=repeats,
            )
