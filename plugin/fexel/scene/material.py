"""Materials: UsdPreviewSurface with constants, textures and primvar readers on its inputs.

Inputs of a material are resolved to a number, a colour, or a texture's output. What cannot be drawn is said once and
replaced as usdrecord replaces it: an unknown surface by the display colour or grey, a damaged texture by its
``inputs:fallback``. A material that does not vary is read once; so is a texture, for all materials together.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

from pxr import Usd, UsdShade

from fexel.errors import FexelError
from fexel.filters.minification import minification_of_prim
from fexel.scene.model import Material, Texture, TextureInput
from fexel.scene.sampling import Faults, Sampler
from fexel.scene.shader_network import (
    Node,
    is_fexel_texture,
    resolve_input,
    resolve_output,
    shader_id,
    texture_coordinates,
    variable_name,
)

__all__ = ["GREY", "SURFACE_DEFAULTS", "UNBOUND", "MaterialReader", "textures_of", "without_textures"]

GREY = (0.18, 0.18, 0.18)
UNBOUND = Material("", {"diffuseColor": GREY}, uses_display_color=True, uses_display_opacity=True)

# Inputs of the UsdPreviewSurface specification 2.6 with their defaults; the type of the default is that of the input.
SURFACE_DEFAULTS: dict[str, float | tuple[float, float, float]] = {
    "diffuseColor": GREY,
    "emissiveColor": (0.0, 0.0, 0.0),
    "useSpecularWorkflow": 0.0,
    "specularColor": (0.0, 0.0, 0.0),
    "metallic": 0.0,
    "roughness": 0.5,
    "clearcoat": 0.0,
    "clearcoatRoughness": 0.01,
    "opacity": 1.0,
    "opacityThreshold": 0.0,
    "ior": 1.5,
    "normal": (0.0, 0.0, 1.0),
    "occlusion": 1.0,
}
_CHANNELS = {"rgb": slice(0, 3), "r": 0, "g": 1, "b": 2, "a": 3}


@dataclass
class _Entry:
    """Something read at one time. `varies` None: not known yet, `prims` are still to be looked through."""

    time: Usd.TimeCode
    result: Any
    varies: bool | None
    prims: list[Usd.Prim] = field(default_factory=list)

    def serves(self, time: Usd.TimeCode) -> bool:
        if self.time == time:
            return True
        if self.varies is None:  # put off until a second time is asked for: one texture may hold ten thousand prims
            self.varies = any(_subtree_varies(prim) for prim in self.prims)
        return not self.varies


class MaterialReader:
    """Reads materials and keeps what does not vary."""

    def __init__(self, faults: Faults):
        self._faults = faults
        self._materials: dict[str, _Entry] = {}
        self._textures: dict[str, _Entry] = {}

    def read(self, prim: Usd.Prim | None, time: Usd.TimeCode) -> Material:
        """The material of a Material prim at a time; `UNBOUND` for None."""
        if not prim:
            return UNBOUND
        key = shared_path(prim)
        entry = self._materials.get(key)
        if entry is None or not entry.serves(time):
            sampler = Sampler(time)
            textures: list[Usd.Prim] = []
            material = self._read_material(prim, sampler, textures)
            entry = _Entry(time, material, True if sampler.varies else None, textures)
            self._materials[key] = entry
        return entry.result

    def serves(self, time: Usd.TimeCode) -> bool:
        """Whether all that was read so far holds at another time too."""
        return all(entry.serves(time) for entry in (*self._materials.values(), *self._textures.values()))

    def _read_material(self, prim: Usd.Prim, sampler: Sampler, textures: list[Usd.Prim]) -> Material:
        path = str(prim.GetPath())
        surface = resolve_output(prim, "surface", sampler, self._faults)
        kind = shader_id(surface.prim, sampler) if surface else ""
        if surface is None or kind != "UsdPreviewSurface":
            found = f"surface with info:id {kind!r}" if surface else "no universal surface output"
            self._faults.warn(path, f"{found}, expected UsdPreviewSurface; display colour or grey is shown")
            return replace(UNBOUND, path=path)
        material = Material(path)
        for name, default in SURFACE_DEFAULTS.items():
            material = self._with_input(material, surface.prim, name, default, sampler, textures)
        return material

    def _with_input(
        self, material: Material, surface: Usd.Prim, name: str, default: Any, sampler: Sampler, textures: list[Usd.Prim]
    ) -> Material:
        """The material with input `name` of its surface added."""
        found = resolve_input(surface, name, sampler, self._faults)
        if isinstance(found, Node):
            kind = shader_id(found.prim, sampler)
            if kind.startswith("UsdPrimvarReader_float"):
                return self._with_display_primvar(material, found.prim, name, default, sampler)
            found = self._texture_input(found, kind, default, name, sampler, textures)
        value = found if isinstance(found, TextureInput) else self._constant(surface, name, found, default)
        return material if value == default else replace(material, inputs={**material.inputs, name: value})

    def _with_display_primvar(
        self, material: Material, reader: Usd.Prim, name: str, default: Any, sampler: Sampler
    ) -> Material:
        """Display colour on diffuseColor, display opacity on opacity; of other primvars the reader's fallback shows."""
        primvar = variable_name(reader, sampler, self._faults)
        fallback = resolve_input(reader, "fallback", sampler, self._faults)
        fallback = self._constant(reader, "fallback", None if isinstance(fallback, Node) else fallback, default)
        inputs = {**material.inputs, name: fallback}
        if (name, primvar) == ("diffuseColor", "displayColor"):
            return replace(material, inputs=inputs, uses_display_color=True)
        if (name, primvar) == ("opacity", "displayOpacity"):
            return replace(material, inputs=inputs, uses_display_opacity=True)
        expected = "expected displayColor on diffuseColor or displayOpacity on opacity"
        self._faults.warn(reader.GetPath(), f"primvar {primvar!r} on {name}, {expected}; its fallback is shown")
        return replace(material, inputs=inputs)

    def _texture_input(
        self, node: Node, kind: str, default: Any, name: str, sampler: Sampler, textures: list[Usd.Prim]
    ) -> TextureInput | Any | None:
        """A texture's output, or the constant that stands in for it; None for the input's default."""
        if kind != "UsdUVTexture" and not is_fexel_texture(node.prim):
            self._faults.warn(node.prim.GetPath(), f"info:id {kind!r} is not known; the default of {name} is shown")
            return None
        output = node.output if node.output in _CHANNELS else "rgb"
        if output != node.output:
            valid = ", ".join(_CHANNELS)
            self._faults.warn(node.prim.GetPath(), f"output {node.output!r}, expected one of {valid}; rgb is used")
        if output == "rgb" and isinstance(default, float):
            output = "r"
        entry = self._texture_entry(node.prim, sampler.time)
        texture = entry.result
        textures.append(node.prim)
        sampler.varies = sampler.varies or bool(entry.varies)
        return TextureInput(texture, output) if texture else _fallback(node.prim, output, name, default, sampler)

    def _texture_entry(self, prim: Usd.Prim, time: Usd.TimeCode) -> _Entry:
        """The texture of a prim, shared by all its users; a result of None, with a warning, where it is damaged."""
        from fexel.textures import extract_texture  # late: reading images costs imports that untextured stages avoid

        key = shared_path(prim)
        entry = self._textures.get(key)
        if entry is None or not entry.serves(time):
            sampler = Sampler(time)
            try:
                kind, data = extract_texture(prim, time)
                st = texture_coordinates(prim, sampler, self._faults)
                minification = minification_of_prim(prim, time, tell=self._tell)  # of the filter `kind` has told
                texture = Texture(str(prim.GetPath()), kind, data, st.primvar, st.transform, minification)
            except FexelError as error:
                self._faults.warn(prim.GetPath(), f"{error}; inputs:fallback is shown")
                texture = None
            entry = _Entry(time, texture, True if sampler.varies else None, [prim])
            self._textures[key] = entry
        return entry

    def _tell(self, prim: Usd.Prim, attribute: str, fault: str) -> None:
        self._faults.warn(f"{prim.GetPath()}.{attribute}", fault)

    def _constant(self, prim: Usd.Prim, name: str, value: Any, default: Any) -> Any:
        """A value as float or 3-tuple, as the default is; the default where it is absent or of another kind."""
        if value is None:
            return default
        numbers: tuple[float, ...] = ()
        with contextlib.suppress(TypeError, ValueError):
            numbers = (float(value),) * 3 if isinstance(value, (int, float)) else tuple(float(x) for x in value)
        wanted = numbers[:1] if isinstance(default, float) else numbers[:3]
        if len(wanted) != (1 if isinstance(default, float) else 3) or not all(map(math.isfinite, wanted)):
            self._faults.warn(
                f"{prim.GetPath()}.inputs:{name}",
                f"{value!r}, expected a finite {_described(default)}; {default} is used",
            )
            return default
        return wanted[0] if isinstance(default, float) else wanted  # pyright: ignore[reportGeneralTypeIssues]


def _described(default: Any) -> str:
    return "number" if isinstance(default, float) else "colour or vector of 3"


def _fallback(prim: Usd.Prim, output: str, name: str, default: Any, sampler: Sampler) -> Any:
    """``inputs:fallback`` of a texture, the channels that `output` stands for; a normal has none but its default."""
    rgba = tuple(float(x) for x in sampler.get(prim.GetAttribute("inputs:fallback"), (0.0, 0.0, 0.0, 1.0)))
    if name == "normal" or not all(map(math.isfinite, rgba)):
        return default
    return rgba[_CHANNELS[output]]


def shared_path(prim: Usd.Prim) -> str:
    """Path by which what is read from a prim is shared: that of the prim in the prototype for an instance proxy."""
    return str((prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath())


def _subtree_varies(prim: Usd.Prim) -> bool:
    """Whether any attribute of a texture or its patches might vary over time."""
    return any(
        _might_vary(attribute)
        for descendant in Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
        for attribute in descendant.GetAuthoredAttributes()
    )


def _might_vary(attribute: Usd.Attribute) -> bool:
    if attribute.HasAuthoredConnections() and attribute.GetName().startswith("inputs:"):
        sources = UsdShade.Utils.GetValueProducingAttributes(UsdShade.Input(attribute))
        return any(source.ValueMightBeTimeVarying() for source in sources)
    return attribute.ValueMightBeTimeVarying()


def textures_of(material: Material) -> Iterator[tuple[str, Texture]]:
    """Input names and textures of a material."""
    for name, value in material.inputs.items():
        if isinstance(value, TextureInput):
            yield name, value.texture


def without_textures(material: Material, primvars: set[str], stage: Usd.Stage, time: Usd.TimeCode) -> Material:
    """The material with the textures that read `primvars` replaced by their fallback, for a mesh that lost those."""
    inputs = dict(material.inputs)
    for name, value in material.inputs.items():
        if isinstance(value, TextureInput) and value.texture.st_primvar in primvars:
            prim = stage.GetPrimAtPath(value.texture.path)
            inputs[name] = _fallback(prim, value.output, name, SURFACE_DEFAULTS[name], Sampler(time))
    return replace(material, inputs=inputs)
