"""UsdLux lights: distant, sphere and dome; of others, and of light shaping, it is said once that they are not drawn."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from fexel.scene.model import Light
from fexel.scene.sampling import Faults, Sampler

__all__ = ["LIGHT_KINDS", "read_light"]

# Turns a y-up dome to z-up, as UsdLuxDomeLight.OrientToStageUpAxis does: by 90 degrees about x.
_Z_POLE_FROM_Y_POLE = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])

LIGHT_KINDS = {"DistantLight": "distant", "SphereLight": "sphere", "DomeLight": "dome", "DomeLight_1": "dome"}


def read_light(prim: Usd.Prim, light_to_world: np.ndarray, sampler: Sampler, faults: Faults) -> Light | None:
    """Read a light prim; None, with a warning, for a kind that is not drawn.

    Parameters
    ----------
    light_to_world : (4, 4) float64
        Row vectors.
    """
    type_name, path = prim.GetTypeName(), prim.GetPath()
    if type_name not in LIGHT_KINDS:
        faults.warn(path, f"{type_name} is not drawn; expected one of {', '.join(LIGHT_KINDS)}")
        return None
    if prim.HasAPI(UsdLux.ShapingAPI):
        faults.warn(path, "light shaping (cone, focus, IES) is not drawn; the light shines in all directions")
    kind = LIGHT_KINDS[type_name]
    light = UsdLux.LightAPI(prim)
    if type_name == "DomeLight_1" and _pole_axis(prim, sampler) == UsdGeom.Tokens.z:
        light_to_world = _Z_POLE_FROM_Y_POLE @ light_to_world
    return Light(
        path=str(path),
        kind=kind,
        color=_radiant_color(light, sampler, faults),
        light_to_world=light_to_world,
        radius=_number(prim, "inputs:radius", 0.5, sampler),
        angle=_number(prim, "inputs:angle", 0.53, sampler),
        normalize=bool(sampler.get(light.GetNormalizeAttr(), False)),
        diffuse=_number(prim, "inputs:diffuse", 1.0, sampler),
        specular=_number(prim, "inputs:specular", 1.0, sampler),
        texture_file=_texture_file(prim, sampler, faults) if kind == "dome" else "",
    )


def _pole_axis(prim: Usd.Prim, sampler: Sampler) -> str:
    """The axis that a DomeLight_1's image has its upper edge on; the stage's up axis unless it says otherwise."""
    axis = sampler.get(prim.GetAttribute("poleAxis"), "scene")
    return UsdGeom.GetStageUpAxis(prim.GetStage()) if axis == "scene" else axis


def _number(prim: Usd.Prim, name: str, default: float, sampler: Sampler) -> float:
    value = float(sampler.get(prim.GetAttribute(name), default))
    return value if np.isfinite(value) else default


def _radiant_color(light: UsdLux.LightAPI, sampler: Sampler, faults: Faults) -> tuple[float, float, float]:
    """Colour times intensity times 2^exposure, times the colour temperature's where it is enabled (UsdLuxLightAPI)."""
    color = np.array(sampler.get(light.GetColorAttr(), (1.0, 1.0, 1.0)), np.float64)
    exposure = np.clip(_number(light.GetPrim(), "inputs:exposure", 0.0, sampler), -60.0, 60.0)  # keeps 2^x a float32
    color = color * _number(light.GetPrim(), "inputs:intensity", 1.0, sampler) * 2.0**exposure
    if sampler.get(light.GetEnableColorTemperatureAttr(), False):
        kelvin = _number(light.GetPrim(), "inputs:colorTemperature", 6500.0, sampler)
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(float(np.clip(kelvin, 1000.0, 10000.0))))
    if not np.isfinite(color).all():
        faults.warn(light.GetPath(), f"colour {tuple(color.tolist())}, expected finite numbers; the light is off")
        return (0.0, 0.0, 0.0)
    return tuple(color.tolist())


def _texture_file(prim: Usd.Prim, sampler: Sampler, faults: Faults) -> str:
    """The dome's latitude-longitude image, resolved, or ''."""
    asset = sampler.get(prim.GetAttribute("inputs:texture:file"))
    if asset is None or not asset.path:
        return ""
    texture_format = sampler.get(prim.GetAttribute("inputs:texture:format"), "automatic")
    if texture_format not in ("automatic", "latlong"):
        faults.warn(prim.GetPath(), f"texture:format {texture_format!r}, expected 'latlong' or 'automatic'; not used")
        return ""
    if not asset.resolvedPath:
        faults.warn(prim.GetPath(), f"texture:file {asset.path!r} cannot be found; the dome has its plain colour")
    return asset.resolvedPath
