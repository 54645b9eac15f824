"""A material as what its program needs: defines, texture slots, uniforms, and how it is blended.

Only features that a material uses are compiled: constant inputs are uniforms, textured ones are texels of a slot, and a
texture that drives several inputs takes one slot. Nothing of the stage's strings goes into a define: input names come
from the table here, slots and outputs are numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fexel.errors import FexelError
from fexel.renderer.program import Define
from fexel.scene.material import SURFACE_DEFAULTS
from fexel.scene.model import Material, Mesh, Texture, TextureInput

__all__ = ["MAX_ST_PRIMVARS", "MAX_TEXTURES", "Surface"]

MAX_TEXTURES = 8  # as many as surface_textures.glsl has slots
MAX_ST_PRIMVARS = 4  # as many as mesh.vert has attributes

# Inputs that are no uniforms: a normal is that of the mesh unless textured, the workflow is compiled in.
_UNIFORMS = {name: value for name, value in SURFACE_DEFAULTS.items() if name not in ("normal", "useSpecularWorkflow")}
# The texture whose st, lod and patch the AOVs show is the first of these that is textured.
_MAIN_ORDER = ("diffuseColor", "emissiveColor", "opacity", "normal", "roughness", "metallic", *_UNIFORMS)
_OUTPUTS = {"rgb": 0, "r": 1, "g": 2, "b": 3, "a": 4}


@dataclass(frozen=True, eq=False)
class Surface:
    """A material on a mesh (whose primvars decide a few features); refers to neither, so that it can be cached by them.

    Attributes
    ----------
    path : str
        Of the material, for messages.
    inputs : dict
        Of the material.
    uses_display_color, uses_display_opacity : bool
        The mesh's primvar replaces the input.
    mesh_st : tuple of str
        Names of the mesh's texture coordinates, for the AOV ``st`` of a surface without textures.
    """

    path: str
    inputs: dict[str, float | tuple[float, float, float] | TextureInput]
    uses_display_color: bool
    uses_display_opacity: bool
    mesh_st: tuple[str, ...]

    @classmethod
    def of(cls, material: Material, mesh: Mesh) -> Surface:
        """The surface of `material` on `mesh`."""
        return cls(
            material.path,
            material.inputs,
            material.uses_display_color and mesh.display_color is not None,
            material.uses_display_opacity and mesh.display_opacity is not None,
            tuple(mesh.st),
        )

    @cached_property
    def _textured(self) -> dict[str, TextureInput]:
        """Textured inputs, in the order that decides the slots: the main texture has slot 0."""
        hidden = {"diffuseColor"} if self.uses_display_color else set()
        hidden |= {"opacity"} if self.uses_display_opacity else set()
        inputs = self.inputs
        names = [name for name in dict.fromkeys(_MAIN_ORDER) if name in inputs and name not in hidden]
        return {name: value for name in names if isinstance(value := inputs[name], TextureInput)}

    @cached_property
    def textures(self) -> tuple[Texture, ...]:
        """Distinct textures; a texture's position is its slot.

        Raises
        ------
        FexelError
            More than 8 textures or 4 sets of texture coordinates in one material.
        """
        textures = tuple(dict.fromkeys(value.texture for value in self._textured.values()))
        if len(textures) > MAX_TEXTURES:
            raise FexelError(f"{self.path}: {len(textures)} textures, at most {MAX_TEXTURES} are supported")
        return textures

    @cached_property
    def st_primvars(self) -> tuple[str, ...]:
        """Primvars that are sent to the shader; a primvar's position is the number of its varying."""
        names = tuple(dict.fromkeys(texture.st_primvar for texture in self.textures))
        if len(names) > MAX_ST_PRIMVARS:
            message = f"{len(names)} sets of texture coordinates, at most {MAX_ST_PRIMVARS} are supported"
            raise FexelError(f"{self.path}: {message}")
        return names or self.mesh_st[:1]

    @cached_property
    def translucent(self) -> bool:
        """Blended with what is behind."""
        inputs = self.inputs
        if self._cut_out:
            return False
        opacity = inputs.get("opacity", 1.0)
        return self.uses_display_opacity or isinstance(opacity, TextureInput) or _number(opacity) < 1.0

    @cached_property
    def _cut_out(self) -> bool:
        threshold = self.inputs.get("opacityThreshold", 0.0)
        return isinstance(threshold, TextureInput) or _number(threshold) > 0.0

    @cached_property
    def defines(self) -> dict[str, Define]:
        """Features of the program, but for lights, AOVs and re-basing."""
        defines: dict[str, Define] = {
            "TEXTURE_COUNT": len(self.textures),
            "ST_COUNT": len(self.st_primvars),
            "MAIN_TEXTURE": 0,
            "MAIN_ST": "st0",
        }
        for slot, texture in enumerate(self.textures):
            defines[f"TEXTURE{slot}_SAMPLE"] = f"{texture.kind}_sample"
            defines[f"TEXTURE{slot}_ST"] = self._varying(texture)
        for name, value in self._textured.items():
            defines[f"{name.upper()}_TEXTURE"] = self.textures.index(value.texture)
            defines[f"{name.upper()}_OUTPUT"] = _output(self.path, value)
        if "normal" in self._textured:
            defines["NORMAL_ST"] = self._varying(self._textured["normal"].texture)
        return defines | self._feature_defines()

    def _feature_defines(self) -> dict[str, Define]:
        inputs = self.inputs
        clearcoat = inputs.get("clearcoat", 0.0)
        features = {
            "DISPLAY_COLOR": self.uses_display_color,
            "DISPLAY_OPACITY": self.uses_display_opacity,
            "CUTOUT": self._cut_out,
            "TRANSLUCENT": self.translucent,
            "SPECULAR_WORKFLOW": _number(inputs.get("useSpecularWorkflow", 0.0)) != 0.0,
            "CLEARCOAT": isinstance(clearcoat, TextureInput) or _number(clearcoat) > 0.0,
        }
        return {name: 1 for name, used in features.items() if used}

    def _varying(self, texture: Texture) -> str:
        return f"st{self.st_primvars.index(texture.st_primvar)}"

    @cached_property
    def uniforms(self) -> dict[str, float | tuple[float, float, float]]:
        """Values of the constant inputs, by the uniform's name; non-finite ones are replaced by the fallback."""
        values = {}
        for name, fallback in _UNIFORMS.items():
            value = self.inputs.get(name, fallback)
            if not isinstance(value, TextureInput):
                values[name] = value if np.all(np.isfinite(value)) else fallback
        return values


def _number(value: object) -> float:
    """A constant float input; a textured one (of an input that cannot be textured) counts as 0."""
    return 0.0 if isinstance(value, TextureInput) else float(np.max(value))  # type: ignore[arg-type]


def _output(path: str, value: TextureInput) -> int:
    if value.output not in _OUTPUTS:
        raise FexelError(f"{path}: texture output {value.output!r}, expected one of {' '.join(_OUTPUTS)}")
    return _OUTPUTS[value.output]
