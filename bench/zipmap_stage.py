"""Zipmaps made for tests and benchmarks: stages from arrays, views of a quad, frames with a texture alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd

import fexel
from fexel import homography, images, mipmaps
from fexel.renderer.program import ProgramCache
from fexel.renderer.visible import View, VisibleSurface, visible_surface
from fexel.scene.model import Draw, Material, Mesh, Texture
from fexel.textures import extract_texture
from fexel.textures.system import TextureRequest, TextureSystem

__all__ = [
    "Patch",
    "compiled_view",
    "front_view",
    "lookup_texture",
    "pixel_st",
    "quad",
    "render_texture",
    "save",
    "tilted_view",
    "vertex_array",
    "zipmap_stage",
    "zipmap_texture",
]


@dataclass(frozen=True)
class Patch:
    """A patch of a test stage: file, matrix (parent to patch) and what else is authored."""

    file: str
    matrix: np.ndarray
    opacity: float = 1.0
    mask: str = ""
    children: tuple[Patch, ...] = ()
    color_space: str = "auto"


def save(path: Path, texels: np.ndarray, dtype: str = "uint8", color_space: str = "raw", levels: int = 1) -> str:
    """Write linear premultiplied texels (H, W, 3 or 4) and return the path."""
    images.write_pyramid(str(path), mipmaps.pyramid(texels, levels), dtype, color_space)
    return str(path)


def zipmap_stage(root: Patch, wrap: str = "clamp") -> Usd.Stage:
    """A stage whose ``/Zipmap`` is this nest."""
    assert fexel.__all__
    stage = Usd.Stage.CreateInMemory()
    _define(stage, "/Zipmap", root)
    prim = stage.GetPrimAtPath("/Zipmap")
    for name in ("wrapS", "wrapT"):
        prim.CreateAttribute(f"inputs:{name}", Sdf.ValueTypeNames.Token).Set(wrap)
    return stage


def _define(stage: Usd.Stage, path: str, patch: Patch) -> None:
    prim = stage.DefinePrim(path, "ZipmapTexture")
    prim.CreateAttribute("inputs:file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(patch.file))
    prim.CreateAttribute("inputs:matrix", Sdf.ValueTypeNames.Matrix3d).Set(
        Gf.Matrix3d(*np.ravel(patch.matrix).tolist())
    )
    prim.CreateAttribute("inputs:opacity", Sdf.ValueTypeNames.Float).Set(patch.opacity)
    prim.CreateAttribute("inputs:sourceColorSpace", Sdf.ValueTypeNames.Token).Set(patch.color_space)
    if patch.mask:
        prim.CreateAttribute("inputs:mask", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath(patch.mask))
    for number, child in enumerate(patch.children):
        _define(stage, f"{path}/patch{number}", child)


def zipmap_texture(stage: Usd.Stage, path: str = "/Zipmap", time: float = 0.0) -> Texture:
    """The texture prim as the renderer gets it."""
    kind, data = extract_texture(stage.GetPrimAtPath(path), time)
    return Texture(path, kind, data)


def quad(st_low=(0.0, 0.0), st_high=(1.0, 1.0)) -> Draw:
    """The square [0, 1]^2 of the plane z = 0 with st as given at its corners."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
    st = points[:, :2] * (np.array(st_high) - st_low) + st_low
    triangles = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    mesh = Mesh("/Quad", points, np.tile(np.float32([0, 0, 1]), (4, 1)), triangles, {"st": st})
    return Draw(mesh, 0, 2, np.eye(4), Material("/Material"), "/Quad", 0)


def front_view(low, high, width: int, height: int) -> View:
    """Orthographic: the rectangle low..high of the plane z = 0 fills the image."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    matrix = np.eye(4)
    matrix[0, 0], matrix[1, 1] = 2 / (high - low)
    matrix[3, :2] = -(high + low) / (high - low)
    return View(matrix, width, height)


def tilted_view(target, distance: float, tilt: float, width: int, height: int, fov: float = 40.0) -> View:
    """Perspective: looks at a point of the plane z = 0, tilted by so many degrees from its normal about the x axis."""
    frustum = Gf.Frustum()
    frustum.SetPerspective(fov, width / height, distance * 1e-3, distance * 1e3)
    angle = np.radians(tilt)
    eye = Gf.Vec3d(float(target[0]), float(target[1]) - distance * np.sin(angle), distance * np.cos(angle))
    camera = Gf.Matrix4d().SetLookAt(eye, Gf.Vec3d(float(target[0]), float(target[1]), 0), Gf.Vec3d(0, 1, 0))
    return View(np.array(camera * frustum.ComputeProjectionMatrix()), width, height)


def render_texture(
    gl, texture: Texture, draw: Draw, view: View, system: TextureSystem | None = None, aovs: bool = False
) -> np.ndarray:
    """(H, W, 4) float32, row 0 at the top: the texture alone, linear and premultiplied; with `aovs`, (H, W, 8)."""
    surface = visible_surface(draw, view, ["st"])
    size = (view.width, view.height)
    targets = [gl.texture(size, 4, dtype="f4") for _ in range(1 + aovs)]
    framebuffer = gl.framebuffer(targets)
    framebuffer.use()
    framebuffer.clear()
    own = system or TextureSystem(gl)
    if surface is not None:
        request = TextureRequest(texture, surface)
        own.begin_view([request])
        binding = own.binding([request])
        defines = binding.defines | {"TEXTURE_SAMPLE": f"{texture.kind}_sample", "TEXTURE_AOVS": int(aovs)}
        program = ProgramCache(gl).get("texture_view.vert", "texture_view.frag", defines, binding.includes)
        binding.apply(program)
        vertex_array(gl, program, draw, surface, view).render()
    result = np.concatenate(
        [np.frombuffer(t.read(), np.float32).reshape(view.height, view.width, 4) for t in targets], -1
    )
    gl.detect_framebuffer(0).use()  # moderngl would bind the released one again
    for item in (framebuffer, *targets):
        item.release()
    if system is None:
        own.release()
    return result[::-1].copy()


def compiled_view(gl, programs, draw: Draw, view: View, textured=None):
    """What draws a quad again and again: ``draw()`` for a ready program, or program, binding and ``draw()`` for a
    (texture, system) pair and a `ProgramCache`.
    """
    surface = visible_surface(draw, view, ["st"])
    if textured is None:
        return vertex_array(gl, programs, draw, surface, view).render
    texture, system = textured
    request = TextureRequest(texture, surface)
    system.begin_view([request])
    binding = system.binding([request])
    defines = binding.defines | {"TEXTURE_SAMPLE": f"{texture.kind}_sample", "TEXTURE_AOVS": 0}
    program = programs.get("texture_view.vert", "texture_view.frag", defines, binding.includes)
    return program, binding, vertex_array(gl, program, draw, surface, view).render


def lookup_texture(
    gl, texture: Texture, draw: Draw, view: View, st: np.ndarray, jacobian: np.ndarray, system: TextureSystem
) -> np.ndarray:
    """(H, W, 4) float32: the texture looked up at given st (H * W, 2) and derivatives (H * W, 2, 2), top row first.

    What is loaded follows from `draw` and `view`; places outside of them may show anything.
    """
    surface = visible_surface(draw, view, ["st"])
    size = (view.width, view.height)
    request = TextureRequest(texture, surface)
    system.begin_view([request])
    binding = system.binding([request])
    frame = surface.st_frames["st"]
    local = np.nan_to_num((st - frame.origin) * frame.scale).reshape(view.height, view.width, 2)
    derivatives = np.nan_to_num(np.swapaxes(jacobian, 1, 2) * frame.scale).reshape(view.height, view.width, 4)
    given = [
        gl.texture(size, 4, np.concatenate([local, local], -1)[::-1].astype(np.float32).tobytes(), dtype="f4"),
        gl.texture(size, 4, derivatives[::-1].astype(np.float32).tobytes(), dtype="f4"),
    ]
    target = gl.texture(size, 4, dtype="f4")
    framebuffer = gl.framebuffer([target])
    framebuffer.use()
    defines = binding.defines | {"TEXTURE_SAMPLE": f"{texture.kind}_sample"}
    program = ProgramCache(gl).get("fullscreen.vert", "texture_lookup.frag", defines, binding.includes)
    unit = binding.apply(program)
    for number, name in enumerate(("lookupSt", "lookupJacobian")):
        given[number].use(unit + number)
        if name in program:  # derivatives are not read where only one mip level is
            program[name] = unit + number
    gl.vertex_array(program, []).render(gl.TRIANGLES, vertices=3)
    result = np.frombuffer(target.read(), np.float32).reshape(view.height, view.width, 4)[::-1].copy()
    gl.detect_framebuffer(0).use()  # moderngl would bind the released one again
    for item in (framebuffer, target, *given):
        item.release()
    return result


def pixel_st(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per pixel of a view of `quad`, top row first: st (N, 2), its Jacobian per pixel (N, 2, 2), whether it shows."""
    plane_to_clip = view.world_to_clip[[0, 1, 3]][:, [0, 1, 3]]
    to_ndc = np.array([[2 / view.width, 0, 0], [0, -2 / view.height, 0], [-1, 1, 1]])
    pixel_to_st = to_ndc @ np.linalg.inv(plane_to_clip)
    x, y = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    w = pixels @ pixel_to_st[:2, 2] + pixel_to_st[2, 2]
    pixel_to_st = pixel_to_st * np.sign(w[np.argmax(np.abs(w))])
    st_ = homography.apply(pixel_to_st, pixels)
    jacobian = homography.jacobian(pixel_to_st, pixels)
    shown = np.isfinite(st_).all(axis=1)
    shown[shown] = ((st_[shown] > 1e-3) & (st_[shown] < 1 - 1e-3)).all(axis=1)
    return st_, jacobian, shown


def vertex_array(gl, program, draw: Draw, surface: VisibleSurface, view: View):
    """What draws a quad with ``texture_view.vert``."""
    if surface.rebased is not None:
        position, st, triangles = surface.rebased.clip_position, surface.rebased.st["st"], surface.rebased.triangles
    else:
        matrix = draw.object_to_world @ view.world_to_clip
        position = (draw.mesh.points @ matrix[:3] + matrix[3]).astype(np.float32)
        st, triangles = draw.mesh.st["st"].astype(np.float32), draw.mesh.triangles
    gl.disable(gl.CULL_FACE | gl.DEPTH_TEST)
    vertices = gl.buffer(np.concatenate([position, st], axis=1).astype(np.float32).tobytes())
    indices = gl.buffer(triangles.astype(np.int32).tobytes())
    return gl.vertex_array(program, [(vertices, "4f 2f", "in_position", "in_st")], indices)
