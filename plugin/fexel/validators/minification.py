"""TextureMinificationAPI: applied where it counts, with values that can be used.

Tokens and limits that the schema gives are checked by ``fexel:Limits`` on fexel's own prims, and here on shaders.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from pxr import Usd, UsdShade

from fexel.filters.minification import numbers_of
from fexel.schema.minification import TextureMinificationAPI
from fexel.schema.wrapper import is_a
from fexel.validators.fault import Fault, authored_values
from fexel.validators.prim_validator import TEXTURES, PrimValidator
from fexel.validators.values import check_limits, limits_of

__all__ = ["VALIDATORS", "check_minification"]

_NAMESPACE = "minification"
_API = TextureMinificationAPI.schema


def check_minification(prim: Usd.Prim) -> Iterator[Fault]:
    """Faults of the schema on a texture, or on a shader."""
    authored = [attribute.GetName() for attribute in prim.GetAuthoredPropertiesInNamespace(_NAMESPACE)]
    if not prim.HasAPI(_API):
        if authored:
            message = f"{_API} is not applied to the prim, expected it in its apiSchemas; nothing of it is used"
            yield Fault(prim.GetPath().AppendProperty(authored[0]), message)
        return
    is_texture = is_a(prim, "FexelTexture")
    shader = "" if is_texture else str(UsdShade.Shader(prim).GetShaderId())
    if not is_texture and shader != "UsdUVTexture":
        yield Fault(prim.GetPath(), f"{_API} on a shader {shader or 'without id'}, expected UsdUVTexture")
        return
    if not is_texture:
        yield from (fault for fault in check_limits(prim) if fault.path.name in authored)
    yield from _check_values(prim)


def _check_values(prim: Usd.Prim) -> Iterator[Fault]:
    for name in ("contrast", "brightness"):
        yield from _check(prim, name, 1, lambda value: math.isfinite(value[0]), "a finite number")
    yield from _check(prim, "attenuationDistance", 1, lambda value: value[0] != 0.0, "more than 0")
    yield from _check(prim, "attenuationColor", 3, _is_color, "finite values from 0")
    distance = prim.GetAttribute(f"{_NAMESPACE}:attenuationDistance")
    is_patch = is_a(prim, "FexelTexture") and is_a(prim.GetParent(), "FexelTexture")
    authored = [numbers_of(value, 1) for _, value in authored_values(distance)] if is_patch else []
    if any(value and math.isfinite(value[0]) for value in authored):
        message = "has no effect on a patch; attenuation is that of the texture which a material reads"
        yield Fault(distance.GetPath(), message, is_error=False)


def _check(
    prim: Usd.Prim, name: str, count: int, is_usable: Callable[[tuple[float, ...]], bool], expected: str
) -> Iterator[Fault]:
    """Values that are not so many numbers, unless limits have that to say, or that cannot be used."""
    attribute = prim.GetAttribute(f"{_NAMESPACE}:{name}")
    for when, value in authored_values(attribute):
        numbers = numbers_of(value, count)
        if numbers is None and not limits_of(attribute):
            wanted = "a number" if count == 1 else f"{count} numbers"
            yield Fault(attribute.GetPath(), f"{value!r}, expected {wanted}{when}")
        elif numbers is not None and not is_usable(numbers):
            yield Fault(attribute.GetPath(), f"{_shown(value)}, expected {expected}{when}")


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _is_color(value: tuple[float, ...]) -> bool:
    return all(math.isfinite(v) and v >= 0.0 for v in value)


VALIDATORS = (
    PrimValidator(
        "fexel:Minification",
        "TextureMinificationAPI must be applied to textures, with values that can be used.",
        (*TEXTURES, "UsdShadeShader"),
        check_minification,
    ),
)
