"""From a USD stage to the `Scene` of a frame.

The hierarchy is walked once; per frame only what varies over time is read again, so that unchanged meshes, materials
and draws are the same objects from frame to frame and a renderer may keep what it made of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from pxr import Sdf, Usd, UsdGeom

from fexel.errors import FexelError
from fexel.scene.camera import find_camera, framing_camera, list_cameras, read_camera
from fexel.scene.draws import DrawBuilder
from fexel.scene.hierarchy import LIGHT, Tree, build_tree
from fexel.scene.light import read_light
from fexel.scene.model import Camera, Draw, Light, Scene
from fexel.scene.sampling import Faults, Sampler

__all__ = ["COMPLEXITIES", "SceneReader"]

COMPLEXITIES = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}  # refine levels, as usdrecord's
_PURPOSES = ("default", "render", "proxy", "guide")


@dataclass(eq=False)
class _State:
    """What is kept for the default time, or for all other times (a lone time sample counts for those only)."""

    tree: Tree
    draws: DrawBuilder
    lights: dict[str, tuple[Sampler, Light | None]]


class SceneReader:
    """Makes the `Scene` of any time from a stage.

    The stage must not be edited while a reader is in use.

    Parameters
    ----------
    stage : Usd.Stage
    purposes : collection of str
        Of ``default render proxy guide``; `default` is always among them. usdrecord's default is ``proxy``.
    mask : iterable of str or Sdf.Path, optional
        Prims to which draws, lights and framing are limited, with all below them.
    complexity : str
        ``low medium high veryhigh``: refine level of subdivision surfaces, 0 to 3.
    lacking : dict of str to str, optional
        Where given, a texture whose coordinates a prim lacks is left out there and noted here: what is lacking, by the
        path of the texture. By default that is an error.

    Raises
    ------
    FexelError
        An unknown purpose or complexity, or a mask path that is malformed or names no prim.

    Examples
    --------
    >>> from pxr import Usd, UsdGeom
    >>> stage = Usd.Stage.CreateInMemory()
    >>> sphere = UsdGeom.Sphere.Define(stage, "/Ball")
    >>> scene = SceneReader(stage).at(aspect=1.0)
    >>> [draw.path for draw in scene.draws]
    ['/Ball']
    """

    def __init__(
        self,
        stage: Usd.Stage,
        purposes: Collection[str] = ("default", "proxy"),
        mask: Iterable[str | Sdf.Path] | None = None,
        complexity: str = "low",
        lacking: dict[str, str] | None = None,
    ):
        self.stage = stage
        self._purposes = _checked_purposes(purposes)
        self._mask = _checked_mask(stage, mask or ())
        if complexity not in COMPLEXITIES:
            raise FexelError(f"complexity {complexity!r}, expected one of {', '.join(COMPLEXITIES)}")
        self._refine_level = COMPLEXITIES[complexity]
        self._faults = Faults()
        self._lacking = lacking
        self._states: dict[bool, _State] = {}
        self._cameras: dict[str | None, Usd.Prim | None] = {}
        self._framing: tuple[tuple[Draw, ...], float | None, Camera] | None = None

    def cameras(self) -> tuple[str, ...]:
        """Paths of the stage's cameras."""
        return list_cameras(self.stage)

    def at(self, time: float | None = None, camera: str | None = None, aspect: float | None = None) -> Scene:
        """The scene at a time.

        Parameters
        ----------
        time : float or None
            Time code; None for the default time.
        camera : str or None
            Path, bare name, or end of a path of a camera. None: `main_cam`, else the first, else one that frames the
            default prim.
        aspect : float or None
            Width over height of the picture; None for the camera's own.

        Raises
        ------
        FexelError
            No such camera, a camera from which no picture can be made, or a mesh without the texture coordinates that
            its material reads.
        """
        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        state = self._state(code)
        state.tree.update(code)
        return Scene(
            draws=state.draws.at(code),
            lights=self._lights(state, code),
            camera=self.camera_at(time, camera, aspect),
            prim_paths=state.draws.prim_paths,
            up_axis=str(UsdGeom.GetStageUpAxis(self.stage)),
            time=time,
        )

    def camera_at(self, time: float | None = None, camera: str | None = None, aspect: float | None = None) -> Camera:
        """The camera alone, as `at` would give it; for the size of a picture beforehand."""
        code = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
        if camera not in self._cameras:  # a search through the stage
            self._cameras[camera] = find_camera(self.stage, camera)
        prim = self._cameras[camera]
        if prim is not None:
            return read_camera(prim, Sampler(code), aspect, self._faults)
        state = self._state(code)
        state.tree.update(code)
        draws = state.draws.at(code)
        if self._framing is None or self._framing[0] is not draws or self._framing[1] != aspect:
            up_axis = UsdGeom.GetStageUpAxis(self.stage)
            self._framing = (draws, aspect, framing_camera(self._framed(draws), up_axis, aspect))
        return self._framing[2]

    def _framed(self, draws: tuple[Draw, ...]) -> tuple[Draw, ...]:
        """Draws of the default prim, unless there is a mask, or nothing below it."""
        default_prim = self.stage.GetDefaultPrim()
        if self._mask or not default_prim:
            return draws
        path = str(default_prim.GetPath())
        return tuple(d for d in draws if d.path == path or d.path.startswith(f"{path}/")) or draws

    def _state(self, code: Usd.TimeCode) -> _State:
        state = self._states.get(code.IsDefault())
        if state is None:
            tree = build_tree(self.stage, self._purposes, self._mask, self._faults, code)
            state = _State(tree, DrawBuilder(self.stage, tree, self._refine_level, self._faults, self._lacking), {})
            self._states[code.IsDefault()] = state
        return state

    def _lights(self, state: _State, code: Usd.TimeCode) -> tuple[Light, ...]:
        """Visible lights; those that neither move nor vary are the same objects as before."""
        lights = []
        for node in state.tree.nodes:
            if node.kind != LIGHT or not node.visible or not node.drawn:
                continue
            path = str(node.prim.GetPath())
            sampler, light = state.lights.get(path, (None, None))
            if sampler is None or (sampler.time != code and (sampler.varies or node.place_varies)):
                sampler = Sampler(code)
                light = read_light(node.prim, node.world, sampler, self._faults)
                state.lights[path] = (sampler, light)
            if light is not None:
                lights.append(light)
        return tuple(lights)


def _checked_purposes(purposes: Collection[str]) -> tuple[str, ...]:
    """`purposes` with `default`, which is always drawn."""
    unknown = [purpose for purpose in purposes if purpose not in _PURPOSES]
    if unknown:
        raise FexelError(f"purpose {unknown[0]!r}, expected some of {', '.join(_PURPOSES)}")
    return tuple(purpose for purpose in _PURPOSES if purpose == "default" or purpose in purposes)


def _checked_mask(stage: Usd.Stage, mask: Iterable[str | Sdf.Path]) -> tuple[Sdf.Path, ...]:
    """Mask paths as Sdf.Paths of prims that exist."""
    paths = []
    for path in mask:
        valid = Sdf.Path.IsValidPathString(str(path))
        if not valid or not Sdf.Path(str(path)).IsAbsoluteRootOrPrimPath() or not stage.GetPrimAtPath(str(path)):
            raise FexelError(f"mask path {str(path)!r}: no such prim in {stage.GetRootLayer().identifier}")
        paths.append(Sdf.Path(str(path)))
    return tuple(paths)
