"""`render` and `Renderer`: a stage in, arrays out.

Arrays have rows from the top; ``color`` is linear Rec.709, premultiplied, on a transparent background.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fexel.errors import FexelError, FexelWarning
from fexel.filters import DEFAULT_ACCESSES, DEFAULT_KERNEL, checked_accesses, checked_filter, checked_kernel
from fexel.renderer.aov import checked_aovs
from fexel.renderer.context import GLContext
from fexel.renderer.frame import FrameRenderer, FrameSettings

if TYPE_CHECKING:
    from pxr import Usd

    from fexel.scene import SceneReader
    from fexel.scene.model import Scene

__all__ = ["DEFAULT_ANISOTROPY", "DEFAULT_TEXTURE_MEMORY_MB", "Renderer", "render"]

DEFAULT_TEXTURE_MEMORY_MB = 512.0
DEFAULT_ANISOTROPY = 8
MAX_ANISOTROPY = 16  # as graphics hardware has it


class Renderer:
    """Renders stages and keeps programs, buffers and textures on the GPU from frame to frame.

    Needs OpenGL 3.3 through EGL (a GPU, or Mesa's software rasteriser), but no display. Several renderers can exist
    side by side; one renderer is for one thread.

    Parameters
    ----------
    texture_memory_mb : float
        Budget for textures on the GPU, in MB of 2^20 bytes; past it, coarser mip levels are used.
    anisotropy : int
        Most probes of a lookup, 1 to 16: largest ratio of a footprint's axes that the filter ``anisotropic`` draws
        without blur.
    filter : str, optional
        Minification filter of all textures, whatever their prims ask for: ``mipmap anisotropic ripmap fipmap``, or of
        this renderer alone ``ewa`` (slow reference) and ``auto`` (per pixel the cheapest that is good enough).
    filter_kernel : str
        What ``fipmap`` shows of a footprint: ``box``, the mean over a pixel, or ``gauss``, the mean weighted by a
        Gaussian of a standard deviation of half a pixel, as ``ewa`` does; smoother, at 20 texels instead of 16.
    fipmap_accesses : int
        Bilinear accesses, of 4 texels each, that ``fipmap`` takes of a box: 4, 6, 8, 12 or 16. With more of them it is
        the sharper, above all where footprints are askew.

    Raises
    ------
    FexelError
        Parameters outside of their range; on first use, when there is no usable OpenGL.

    Examples
    --------
    >>> with Renderer() as renderer:                                            # doctest: +SKIP
    ...     for frame in range(1, 49):
    ...         images = renderer.render("poster.usda", time=frame, width=640)
    """

    def __init__(
        self,
        *,
        texture_memory_mb: float = DEFAULT_TEXTURE_MEMORY_MB,
        anisotropy: int = DEFAULT_ANISOTROPY,
        filter: str | None = None,
        filter_kernel: str = DEFAULT_KERNEL,
        fipmap_accesses: int = DEFAULT_ACCESSES,
    ) -> None:
        if not texture_memory_mb > 0.0:
            raise FexelError(f"texture memory: {texture_memory_mb} MB, expected more than 0")
        if not 1 <= anisotropy <= MAX_ANISOTROPY:
            raise FexelError(f"anisotropy: {anisotropy}, expected 1 to {MAX_ANISOTROPY}")
        self._texture_options: dict[str, Any] = {"memory_mb": float(texture_memory_mb), "anisotropy": int(anisotropy)}
        self._texture_options["filter"] = None if filter is None else checked_filter(filter)
        self._texture_options["filter_kernel"] = checked_kernel(filter_kernel)
        self._texture_options["fipmap_accesses"] = checked_accesses(fipmap_accesses, filter_kernel)
        self._context = GLContext()
        self._frames: FrameRenderer | None = None
        self._reader: tuple[tuple, SceneReader] | None = None
        self._edits: Any = None
        self._frame_count = 0
        self._seconds_reading = 0.0

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the GPU; the renderer can be used again."""
        if self._frames is not None:
            with self._context:
                self._frames.release()
            self._frames = None
        self._context.release()
        self._forget_stage()

    def render(
        self,
        stage: str | os.PathLike | Usd.Stage,
        *,
        camera: str | None = None,
        width: int = 960,
        height: int | None = None,
        time: float | None = None,
        aovs: Sequence[str] = ("color",),
        samples: int = 4,
        camera_light: bool = True,
        purposes: Sequence[str] = ("default", "proxy"),
        mask: Sequence[str] | None = None,
        complexity: str = "low",
        cull_back_faces: bool = False,
        dome_visible: bool = False,
        conform_policy: str = "expandAperture",
        pixel_aspect: float = 1.0,
    ) -> dict[str, np.ndarray]:
        """Render one frame of a stage.

        Parameters
        ----------
        stage : path or Usd.Stage
            A stage that is given again is not read again unless it, or the file at the path, has changed.
        camera : str, optional
            Path or name; default: ``main_cam``, else the first camera, else one that frames the default prim.
        width, height : int
            Pixels; `height` follows from the camera's aspect when it is not given.
        time : float, optional
            Time code; None is the default time.
        aovs : sequence of str
            Out of ``color alpha depth cameraDepth normal Neye position st lod patch footprint fetches filter decision
            primId``.
        samples : int
            Per pixel, for ``color`` and ``alpha``.
        camera_light : bool
            Light a stage without lights from the camera.
        purposes, mask, complexity
            As in usdrecord: drawn purposes (``default`` always), prims to limit the stage to, refinement.
        cull_back_faces : bool
            Leave out back faces of meshes that are not ``doubleSided``. By default, as in usdrecord, both are drawn.
        dome_visible : bool
            Show dome lights in the background.
        conform_policy : str
            When `height` is given: how the camera is fitted to it, see UsdRenderSettings.aspectRatioConformPolicy.
        pixel_aspect : float
            Width over height of a pixel.

        Returns
        -------
        dict of str to (height, width, C) float32
            By AOV, rows from the top. ``color`` is linear Rec.709 RGBA, premultiplied.

        Raises
        ------
        FexelError
            Unreadable stage, unknown camera or AOV, impossible size, no OpenGL.

        Examples
        --------
        >>> images = fexel.Renderer().render("poster.usda", width=320, aovs=("color", "depth"))  # doctest: +SKIP
        >>> images["depth"].shape                                                                # doctest: +SKIP
        (180, 320, 1)
        """
        names = checked_aovs(aovs)
        reader = self._scene_reader(stage, tuple(purposes), None if mask is None else tuple(mask), complexity)
        scene = self._read(reader, time, camera)
        from fexel.scene import image_height

        settings = FrameSettings(
            width=width,
            height=image_height(width, scene.camera.aspect) if height is None else height,
            aovs=names,
            samples=samples,
            camera_light=camera_light,
            cull_back_faces=cull_back_faces,
            dome_visible=dome_visible,
            conform_policy=conform_policy,
            pixel_aspect=pixel_aspect,
        )
        return self.draw(scene, settings)

    def draw(self, scene: Scene, settings: FrameSettings) -> dict[str, np.ndarray]:
        """Render an extracted scene; arrays as `render` returns them."""
        if not any(draw.triangle_count for draw in scene.draws):
            warnings.warn("the stage has nothing to draw; the image is empty", FexelWarning, stacklevel=2)
        with self._context as gl:
            if self._frames is None:
                self._frames = FrameRenderer(gl, self._texture_options)
            self._frame_count += 1
            return self._frames.draw(scene, settings)

    def stats(self) -> dict[str, Any]:
        """What was drawn and loaded since the renderer was made; fit for JSON.

        Keys: ``device``, ``frames``, ``tiles``, ``draws``, ``rebasedDraws``, ``programs``, ``meshBytes``, ``seconds``
        per phase, ``textures`` (patches seen and loaded, levels, chains, resident bytes, dropped levels, filters).
        """
        if self._frames is None:
            return {"frames": 0}
        frames = self._frames
        seconds = {"scene": self._seconds_reading, **frames.stats.seconds}
        return {
            "device": self._context.description,
            "frames": self._frame_count,
            **frames.stats.counts,
            "programs": len(frames.state.programs),
            "meshBytes": frames.state.meshes.nbytes,
            "seconds": {name: round(value, 6) for name, value in seconds.items()},
            "textures": frames.state.texture_stats(),
        }

    def _read(self, reader: SceneReader, time: float | None, camera: str | None) -> Scene:
        from time import perf_counter

        start = perf_counter()
        try:
            return reader.at(time=time, camera=camera)
        finally:
            self._seconds_reading += perf_counter() - start

    def _scene_reader(
        self, stage: str | os.PathLike | Usd.Stage, purposes: tuple, mask: tuple | None, complexity: str
    ) -> SceneReader:
        from fexel.scene import SceneReader
        from fexel.stage import open_stage

        key = (_stamp(stage), purposes, mask, complexity)
        if self._reader is None or self._reader[0] != key:
            self._forget_stage()
            opened = open_stage(stage) if isinstance(stage, (str, os.PathLike)) else stage
            self._reader = (key, SceneReader(opened, purposes=purposes, mask=mask, complexity=complexity))
            self._watch(opened)
        return self._reader[1]

    def _watch(self, stage: Usd.Stage) -> None:
        from pxr import Tf, Usd

        self._edits = Tf.Notice.Register(Usd.Notice.ObjectsChanged, lambda *_: self._forget_stage(), stage)

    def _forget_stage(self) -> None:
        if self._edits is not None:
            self._edits.Revoke()
        self._edits = self._reader = None


def _stamp(stage: str | os.PathLike | Usd.Stage) -> tuple:
    """Equal for the same stage; a file that was written again counts as another stage."""
    if not isinstance(stage, (str, os.PathLike)):
        return (stage,)
    try:
        return (os.fspath(stage), os.stat(stage).st_mtime_ns)
    except OSError:
        return (os.fspath(stage),)


def render(stage: str | os.PathLike | Usd.Stage, **options: Any) -> dict[str, np.ndarray]:
    """Render one frame of a stage and free the GPU again.

    Takes what `Renderer` and `Renderer.render` take.

    Returns
    -------
    dict of str to (height, width, C) float32
        By AOV, rows from the top; ``color`` is linear Rec.709 RGBA, premultiplied.

    Examples
    --------
    >>> import fexel
    >>> images = fexel.render("stages/wall.usda", width=320, aovs=("color", "depth"))  # doctest: +SKIP
    """
    own = ("texture_memory_mb", "anisotropy", "filter", "filter_kernel", "fipmap_accesses")
    construction = {name: options.pop(name) for name in own if name in options}
    with Renderer(**construction) as renderer:
        return renderer.render(stage, **options)
