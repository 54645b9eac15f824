"""Complete a stage whose zipmaps were placed by hand: colours, masks and the fallback, as a layer over it.

The output sublayers the input, which stays as it is, and overrides of each nested ZipmapTexture the file (a texture
with matched colours and the blend mask), of each root the fallback. A patch with ``inputs:mask`` keeps it and gets no
automatic one. Root textures, matrices, opacities and everything else are the artist's.
"""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

import fexel
from fexel.errors import FexelError, FexelWarning
from fexel.images import image_info
from fexel.stage import open_stage
from fexel.textures.zipmap import ImageSource, ZipmapData, extract
from fexel_tools import fallback
from fexel_tools.authoring import ZipmapOptions, prim_names
from fexel_tools.inspect import zipmap_roots
from fexel_tools.patches import PatchJob, write_textures
from fexel_tools.photos import Photo, check_mask, probe_photo
from fexel_tools.progress import Progress, silent
from fexel_tools.staged_output import StagedOutput, check_output, staged_output
from fexel_tools.zipmap_stage import st_from_pixels

__all__ = ["complete_stage"]

_METADATA = (
    "defaultPrim", "upAxis", "metersPerUnit", "kilogramsPerUnit", "timeCodesPerSecond", "framesPerSecond",
    "startTimeCode", "endTimeCode", "colorConfiguration", "colorManagementSystem", "renderSettingsPrimPath",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _PlacedPatch:
    """A texture of the nest; `color_space` is what the renderer decodes its file by: sRGB or raw."""

    path: Sdf.Path
    photo: Photo
    color_space: str
    root_from_photo: np.ndarray
    opacity: float
    mask: str
    is_root: bool


def complete_stage(
    source: str | Path, out: str | Path, options: ZipmapOptions, *, progress: Progress | None = None
) -> None:
    """Write the completing layer and its textures; see the module.

    Raises
    ------
    FexelError
        The stage has no ZipmapTexture, an image is missing or unreadable, a matrix has no inverse, or the output would
        replace an input.
    """
    stage = open_stage(source)
    roots = zipmap_roots(stage)
    if not roots:
        raise FexelError(f"{source}: holds no ZipmapTexture")
    placed = [_placed_patches(root) for root in roots]
    layers = [layer.realPath for layer in stage.GetUsedLayers() if layer.realPath]
    check_output(out, layers + [file for nest in placed for p in nest for file in (p.photo.file, p.mask) if file])
    with staged_output(out) as staged:
        layer = _layer_over(Path(source), stage, staged)
        _complete(layer, placed, staged, options, progress or silent)
        _set_sublayer(layer, Path(source), Path(out).parent)  # no stage is open on it any more
        layer.Save()


def _complete(
    layer: Sdf.Layer, placed: list[list[_PlacedPatch]], staged: StagedOutput, options: ZipmapOptions, step: Progress
) -> None:
    """Textures and fallback of each root, and the opinions that name them."""
    over = Usd.Stage.Open(layer)
    for number, patches in enumerate(placed):
        names = prim_names([p.path.name for p in patches])
        jobs = [_job(staged, p, name, number, options) for p, name in zip(patches, names, strict=True)]
        step("colours and textures", number, len(placed))
        write_textures(jobs, options.jobs)
        for patch, job in zip(patches[1:], jobs[1:], strict=True):
            _author_file(over.GetPrimAtPath(patch.path), f"./{staged.textures.name}/{job.file.name}", job.color_space)
        image = staged.textures / (f"fallback_{number}.png" if number else "fallback.png")
        fallback.write_fallback(over.GetPrimAtPath(patches[0].path), image, options.fallback_size)
    step("colours and textures", len(placed), len(placed))
    over.WriteFallbackPrimTypes()


def _author_file(prim: Usd.Prim, file: str, color_space: str) -> None:
    """The new file in place of the artist's: a connection or a colour space authored below must not win over it."""
    texture = fexel.ZipmapTexture(prim)
    attributes = {
        texture.CreateFileAttr(): Sdf.AssetPath(file),
        texture.CreateSourceColorSpaceAttr(): color_space,
    }
    for attribute, value in attributes.items():
        if attribute.HasAuthoredConnections():
            attribute.SetConnections([])
        attribute.Set(value)
    if texture.GetFileAttr().HasColorSpace():
        texture.GetFileAttr().SetColorSpace(color_space)


def _layer_over(source: Path, stage: Usd.Stage, staged: StagedOutput) -> Sdf.Layer:
    layer = Sdf.Layer.CreateNew(str(staged.stage))
    _set_sublayer(layer, source, staged.stage.parent)
    root = stage.GetRootLayer().pseudoRoot
    for key in _METADATA:
        if root.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, root.GetInfo(key))
    if not root.HasInfo("upAxis"):
        layer.pseudoRoot.SetInfo("upAxis", str(UsdGeom.GetStageUpAxis(stage)))
    return layer


def _set_sublayer(layer: Sdf.Layer, source: Path, folder: Path) -> None:
    relative = Path(os.path.relpath(source.resolve(), folder.resolve())).as_posix()
    layer.subLayerPaths[:] = [relative if relative.startswith(".") else f"./{relative}"]


def _placed_patches(root: fexel.ZipmapTexture) -> list[_PlacedPatch]:
    """The nest as the renderer reads it, connections followed, with its photos probed and its masks read once."""
    patches = [p for p in root.GetPatches() if fexel.ZipmapTexture(p.prim)]
    to_root = [_invert(p.path, p.root_to_patch) for p in patches]
    data = _rendered(root.GetPrim())
    images = dict(zip(data.paths, (data.sources[k] for k in data.source_index), strict=True))
    placed: list[_PlacedPatch] = []
    for patch, root_from_patch in zip(patches, to_root, strict=True):
        if str(patch.path) not in images:
            raise FexelError(f"{patch.path}.inputs:matrix: is singular, not finite, or maps infinity into the texture")
        image = images[str(patch.path)]
        photo, color_space = _photo(patch.path, image)
        mask = _existing(patch.path, "inputs:mask", image.mask) if image.mask else ""
        if mask:
            check_mask(mask)
        relative = (root_from_patch @ patches[0].root_to_patch).T if placed else np.eye(3)
        top = placed[0].photo if placed else photo
        root_from_st = np.linalg.inv(st_from_pixels((0, 0, top.width, top.height)))
        matrix = root_from_st @ relative @ st_from_pixels((0, 0, photo.width, photo.height))
        w = matrix[2] @ [photo.width / 2.0, photo.height / 2.0, 1.0]
        placed.append(_PlacedPatch(patch.path, photo, color_space, matrix / w, patch.opacity, mask, not placed))
    return placed


def _rendered(prim: Usd.Prim) -> ZipmapData:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FexelWarning)  # baking the fallback reads the same and tells
        return extract(prim, Usd.TimeCode.Default())


def _photo(path: Sdf.Path, image: ImageSource) -> tuple[Photo, str]:
    """The photo, and sRGB or raw as the renderer decides; profiles and primaries that the file states are kept."""
    photo = probe_photo(_existing(path, "inputs:file", image.file))
    stated = image.color_space != "auto"
    color_space = image.color_space if stated else image_info(photo.file).color_space
    if stated or (photo.is_srgb and color_space == "raw"):
        name = "srgb_rec709_scene" if color_space == "sRGB" else "lin_rec709_scene"
        photo = replace(photo, color_space=name, chromaticities=None)
    return photo, color_space


def _job(staged: StagedOutput, patch: _PlacedPatch, name: str, number: int, options: ZipmapOptions) -> PatchJob:
    photo, is_root = patch.photo, patch.is_root
    bits = options.bits or {"uint8": 8, "uint16": 16}.get(photo.pixel_type, "half")
    file = staged.textures / f"{name}{f'_{number}' if number else ''}{'.exr' if bits == 'half' else '.tif'}"
    return PatchJob(
        photo=photo,
        window=(0, 0, photo.width, photo.height),
        root_from_photo=patch.root_from_photo,
        file=Path(photo.file) if is_root else file,
        bits=(8 if patch.color_space == "sRGB" else "half") if is_root else bits,
        is_root=is_root,
        match_colors=options.match_colors,
        blend=not patch.mask,
        tau=options.tau,
        opacity=patch.opacity,
        mask=patch.mask,
        ready=is_root,
    )


def _invert(path: Sdf.Path, matrix: np.ndarray) -> np.ndarray:
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-300:
        raise FexelError(f"{path}.inputs:matrix: is singular or not finite")
    return np.linalg.inv(matrix)


def _existing(path: Sdf.Path, name: str, file: str) -> str:
    if not file:
        raise FexelError(f"{path}.{name}: names no file")
    if not Path(file).exists():
        raise FexelError(f"{path}.{name}: {file}: no such file")
    return file
