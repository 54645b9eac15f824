"""Complete a stage whose zipmaps were placed by hand: colours, masks and the fallback, as a layer over it.

The output sublayers the input, which stays as it is, and overrides of each nested ZipmapTexture the file (a texture
with matched colours and the blend mask), of each root the fallback. A patch with ``inputs:mask`` keeps it and gets no
automatic one. Root textures, matrices, opacities and everything else are the artist's.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd, UsdGeom

import fexel
from fexel.errors import FexelError
from fexel.stage import open_stage
from fexel_tools.authoring import ZipmapOptions, prim_names
from fexel_tools.inspect import zipmap_roots
from fexel_tools.patches import PatchJob, write_textures
from fexel_tools.photos import Photo, probe_photo
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
    prim: Usd.Prim
    photo: Photo
    job: PatchJob


def complete_stage(
    source: str | Path, out: str | Path, options: ZipmapOptions, *, progress: Progress | None = None
) -> None:
    """Write the completing layer and its textures; see the module.

    Raises
    ------
    FexelError
        The stage has no ZipmapTexture with patches, or an image is missing or unreadable.
    """
    from fexel_tools import fallback

    stage = open_stage(source)
    roots = zipmap_roots(stage)
    if not roots:
        raise FexelError(f"{source}: holds no ZipmapTexture")
    check_output(out, _files_of(stage, roots))
    step = progress or silent
    with staged_output(out) as staged:
        layer = _layer_over(Path(source), stage, staged)
        over = Usd.Stage.Open(layer)
        for number, root in enumerate(roots):
            placed = _placed_patches(root, staged, options, number)
            step("colours and textures", number, len(roots))
            write_textures([p.job for p in placed], options.jobs)
            for patch in placed[1:]:
                texture = fexel.ZipmapTexture(over.GetPrimAtPath(patch.prim.GetPath()))
                texture.CreateFileAttr(Sdf.AssetPath(f"./{staged.textures.name}/{patch.job.file.name}"))
                texture.CreateSourceColorSpaceAttr(patch.job.color_space)
            image = staged.textures / (f"fallback_{number}.png" if number else "fallback.png")
            fallback.write_fallback(over.GetPrimAtPath(root.GetPath()), image, options.fallback_size)
        step("colours and textures", len(roots), len(roots))
        over.WriteFallbackPrimTypes()
        _set_sublayer(layer, Path(source), Path(out).parent)
        layer.Save()


def _files_of(stage: Usd.Stage, roots: list[fexel.ZipmapTexture]) -> list[str]:
    """Layers, pictures and masks: what the output must not replace."""
    files = [layer.realPath for layer in stage.GetUsedLayers() if layer.realPath]
    for patch in (patch for root in roots for patch in root.GetPatches()):
        files += [_asset(patch.prim, name, needed=False) for name in ("inputs:file", "inputs:mask")]
    return [file for file in files if file]


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


def _placed_patches(
    root: fexel.ZipmapTexture, staged: StagedOutput, options: ZipmapOptions, number: int
) -> list[_PlacedPatch]:
    patches = [p for p in root.GetPatches() if fexel.ZipmapTexture(p.prim)]
    photos = [probe_photo(_asset(p.prim, "inputs:file")) for p in patches]
    names = prim_names([p.prim.GetName() for p in patches])
    root_st_from_pixels = st_from_pixels((0, 0, photos[0].width, photos[0].height))
    placed = []
    for patch, photo, name in zip(patches, photos, names, strict=True):
        relative = patch.root_to_patch if patch.path != root.GetPath() else np.eye(3)
        if patch.path != root.GetPath():
            relative = np.linalg.solve(patches[0].root_to_patch, patch.root_to_patch)
        st_from_photo = st_from_pixels((0, 0, photo.width, photo.height))
        root_from_photo = _invert(patch.path, root_st_from_pixels) @ _invert(patch.path, relative.T) @ st_from_photo
        w = root_from_photo[2] @ [photo.width / 2.0, photo.height / 2.0, 1.0]
        is_root = patch.path == root.GetPath()
        placed.append(
            _PlacedPatch(
                patch.prim, photo, _job(staged, photo, name, root_from_photo / w, patch, is_root, number, options)
            )
        )
    return placed


def _job(staged, photo, name, matrix, patch, is_root, number, options) -> PatchJob:
    bits = options.bits or {"uint8": 8, "uint16": 16}.get(photo.pixel_type, "half")
    file = staged.textures / f"{name}{f'_{number}' if number else ''}{'.exr' if bits == 'half' else '.tif'}"
    mask = _asset(patch.prim, "inputs:mask", needed=False)
    return PatchJob(
        photo=photo,
        window=(0, 0, photo.width, photo.height),
        root_from_photo=matrix,
        file=Path(photo.file) if is_root else file,
        bits=(8 if photo.is_srgb else "half") if is_root else bits,
        is_root=is_root,
        match_colors=options.match_colors,
        blend=not mask,
        tau=options.tau,
        opacity=patch.opacity,
        mask=mask,
        ready=is_root,
    )


def _invert(path: Sdf.Path, matrix: np.ndarray) -> np.ndarray:
    if not np.isfinite(matrix).all() or abs(np.linalg.det(matrix)) < 1e-300:
        raise FexelError(f"{path}.inputs:matrix: is singular or not finite")
    return np.linalg.inv(matrix)


def _asset(prim: Usd.Prim, name: str, needed: bool = True) -> str:
    value = prim.GetAttribute(name).Get()
    if value is None or not value.path:
        if needed:
            raise FexelError(f"{prim.GetPath()}.{name}: names no file")
        return ""
    if not value.resolvedPath:
        raise FexelError(f"{prim.GetPath()}.{name}: {value.path}: no such file")
    return str(value.resolvedPath)
