"""One frame of a scene: tiles, passes, samples.

Per tile: what is in view is found (`view_list`), its textures are made resident, then the colour pass is drawn, opaque
surfaces first, translucent ones from back to front (sorted by draw, not by triangle), and, only when asked for, the
data pass. Up to the hardware's limit samples are multisamples of float16; beyond it the tile is drawn once per sample
with offsets that fill the pixel's box, and averaged in float32, which supersamples the shading as well.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from fexel.errors import FexelError
from fexel.renderer.aov import AOVS, Aov, aov_defines, data_aovs
from fexel.renderer.draw_state import DrawState
from fexel.renderer.targets import DataTarget, Targets
from fexel.renderer.view_list import ViewList, Viewpoint
from fexel.renderer.viewport import Tile, conform_projection, sample_offsets, tiles

if TYPE_CHECKING:
    import moderngl

    from fexel.scene.model import Scene

__all__ = ["FrameRenderer", "FrameSettings", "FrameStats"]

MAX_SIZE_PX = 65536  # a float32 RGBA image of that square is 64 GiB; guards a mistyped size
_MAX_LOCATIONS = 8  # OpenGL 3.3 guarantees eight draw buffers


@dataclass(frozen=True)
class FrameSettings:
    """What does not depend on the scene.

    Attributes
    ----------
    width, height : int
        Pixels.
    aovs : tuple of Aov
    samples : int
        Per pixel, of the colour.
    camera_light : bool
        Headlight for a scene without lights.
    cull_back_faces : bool
        Leave out back faces of surfaces that are not double-sided.
    dome_visible : bool
        Draw the dome lights behind everything, opaque.
    conform_policy : str
        How the camera is fitted to the image's aspect; as in UsdRenderSettings.
    pixel_aspect : float
        Width over height of a pixel.
    """

    width: int
    height: int
    aovs: tuple[Aov, ...] = (AOVS["color"],)
    samples: int = 4
    camera_light: bool = True
    cull_back_faces: bool = False
    dome_visible: bool = False
    conform_policy: str = "expandAperture"
    pixel_aspect: float = 1.0

    def __post_init__(self) -> None:
        for name, value in (("width", self.width), ("height", self.height)):
            if not 1 <= value <= MAX_SIZE_PX:
                raise FexelError(f"{name} of the image: {value} pixels, expected 1 to {MAX_SIZE_PX}")
        if not 1 <= self.samples <= 4096:
            raise FexelError(f"samples: {self.samples}, expected 1 to 4096")
        if not 0.0 < self.pixel_aspect < math.inf:
            raise FexelError(f"pixel aspect ratio: {self.pixel_aspect}, expected more than 0")


@dataclass
class FrameStats:
    """Seconds per phase, and counts, summed over frames."""

    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def phase(self, name: str):
        """Add the time spent inside to `name`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def count(self, name: str, number: int) -> None:
        """Add to a count."""
        self.counts[name] = self.counts.get(name, 0) + number


class FrameRenderer:
    """Draws frames in one context, which must be current; keeps buffers, programs and textures between frames.

    `texture_options` are keywords of `fexel.textures.system.TextureSystem`.
    """

    def __init__(self, gl: moderngl.Context, texture_options: Mapping[str, Any]) -> None:
        self._gl = gl
        self._targets = Targets(gl)
        self.state = DrawState(gl, texture_options)
        self.stats = FrameStats()

    def draw(self, scene: Scene, settings: FrameSettings) -> dict[str, np.ndarray]:
        """All AOVs of a frame: (height, width, channels) float32 by name, row 0 at the top."""
        images = _empty_images(settings)
        aspect = settings.width * settings.pixel_aspect / settings.height
        projection = conform_projection(scene.camera, aspect, settings.conform_policy)
        self.state.begin_frame(scene, settings.camera_light)
        for tile in tiles(settings.width, settings.height):
            viewpoint = Viewpoint.of(scene.camera, projection, tile)
            with self.stats.phase("visibility"):
                view_list = ViewList.of(scene, viewpoint)
            try:
                with self.stats.phase("textures"):
                    self.state.begin_view(view_list)
                for name, pixels in self._draw_tile(view_list, tile, settings).items():
                    images[name][tile.y : tile.y + tile.height, tile.x : tile.x + tile.width] = pixels
            finally:
                self.state.end_view()
            self._count(view_list)
        self._check()
        return images

    def _draw_tile(self, view_list: ViewList, tile: Tile, settings: FrameSettings) -> dict[str, np.ndarray]:
        images: dict[str, np.ndarray] = {}
        names = [aov.name for aov in settings.aovs]
        if "color" in names or "alpha" in names:
            with self.stats.phase("color"):
                color = self._color(view_list, tile, settings)
            images |= {"color": color, "alpha": color[..., 3:]}
        data = data_aovs(settings.aovs)
        if data:
            with self.stats.phase("data"):
                images |= self._data(view_list, tile, settings, data)
        return {name: images[name] for name in names}

    def _color(self, view_list: ViewList, tile: Tile, settings: FrameSettings) -> np.ndarray:
        limit = self._gl.max_samples
        if settings.samples == 1:
            return self._color_pass(view_list, tile, settings, 0, (0.0, 0.0))
        if settings.samples <= limit:
            return self._color_pass(view_list, tile, settings, settings.samples, (0.0, 0.0))
        total = np.zeros((tile.height, tile.width, 4), np.float32)
        for offset in sample_offsets(settings.samples):
            total += self._color_pass(view_list, tile, settings, 0, tuple(offset))
        return total / np.float32(settings.samples)

    def _color_pass(
        self, view_list: ViewList, tile: Tile, settings: FrameSettings, samples: int, offset_px: tuple[float, float]
    ) -> np.ndarray:
        target = self._targets.color((tile.width, tile.height), samples)
        self._begin(target.frame, (0.0, 0.0, 0.0, 0.0))
        passed = self.state.begin_pass({}, target.largest_value, offset_px, (tile.width, tile.height))
        if settings.dome_visible:
            self.state.draw_dome(view_list.viewpoint, passed)
        for item in view_list.opaque:
            self.state.draw(item, passed, cull="back" if settings.cull_back_faces and not item.double_sided else "")
        gl = self._gl
        gl.enable(gl.BLEND)
        gl.blend_func = gl.ONE, gl.ONE_MINUS_SRC_ALPHA
        target.frame.depth_mask = False
        for item in view_list.translucent:
            if item.double_sided or not settings.cull_back_faces:
                self.state.draw(item, passed, cull="front")
            self.state.draw(item, passed, cull="back")
        target.frame.depth_mask = True
        gl.disable(gl.BLEND)
        return target.read()

    def _data(
        self, view_list: ViewList, tile: Tile, settings: FrameSettings, aovs: Sequence[Aov]
    ) -> dict[str, np.ndarray]:
        """Data AOVs; primId is always drawn, since it tells where there is nothing."""
        others = [aov for aov in aovs if aov.name != "primId"]
        images: dict[str, np.ndarray] = {}
        for first in range(0, max(len(others), 1), _MAX_LOCATIONS - 1):
            group = (AOVS["primId"], *others[first : first + _MAX_LOCATIONS - 1])
            target = self._targets.data((tile.width, tile.height), group)
            self._data_pass(view_list, tile, settings, group, target)
            images |= target.read()
        nothing = images["primId"][..., 0] < 0.0
        if "position" in images:
            images["position"] = images["position"] + view_list.viewpoint.eye.astype(np.float32)
        return {aov.name: _with_background(images[aov.name], nothing, aov) for aov in aovs}

    def _data_pass(
        self, view_list: ViewList, tile: Tile, settings: FrameSettings, group: Sequence[Aov], target: DataTarget
    ) -> None:
        self._begin(target.frame, (-1.0, -1.0, -1.0, -1.0))
        passed = self.state.begin_pass(aov_defines(group), target.largest_value, (0.0, 0.0), (tile.width, tile.height))
        for item in (*view_list.opaque, *view_list.translucent):
            self.state.draw(item, passed, cull="back" if settings.cull_back_faces and not item.double_sided else "")

    def _begin(self, frame: moderngl.Framebuffer, clear: tuple[float, float, float, float]) -> None:
        gl = self._gl
        frame.use()
        frame.viewport = (0, 0, frame.width, frame.height)
        gl.disable(gl.BLEND | gl.CULL_FACE)
        gl.enable(gl.DEPTH_TEST)
        gl.depth_func = "<="
        frame.clear(*clear, depth=1.0)

    def _count(self, view_list: ViewList) -> None:
        self.stats.count("tiles", 1)
        self.stats.count("draws", len(view_list.opaque) + len(view_list.translucent))
        self.stats.count("rebasedDraws", sum(item.rebased is not None for item in view_list.items))

    def _check(self) -> None:
        error = self._gl.error
        if error != "GL_NO_ERROR":
            raise FexelError(f"OpenGL reports {error} after the frame; out of memory or a driver's fault")

    def release(self) -> None:
        """Free everything."""
        self._targets.release()
        self.state.release()


def _empty_images(settings: FrameSettings) -> dict[str, np.ndarray]:
    shape = (settings.height, settings.width)
    try:
        return {aov.name: np.empty((*shape, len(aov.channels)), np.float32) for aov in settings.aovs}
    except MemoryError:
        names = " ".join(aov.name for aov in settings.aovs)
        raise FexelError(f"not enough memory for {settings.width} x {settings.height} pixels of {names}") from None


def _with_background(image: np.ndarray, nothing: np.ndarray, aov: Aov) -> np.ndarray:
    image = image.copy()
    image[nothing] = aov.background
    return image
