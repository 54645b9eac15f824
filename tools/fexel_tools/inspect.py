"""What a stage's textures hold: patches, nesting, sizes, resolution gained, bytes. The work behind ``fexel info``.

Resolution gained is the number of a patch's texels per texel of the root at the patch's centre, along an axis
(geometric mean of both). Bytes on disk count each file once. Bytes resident are those of all mip levels of all
textures at full resolution in the renderer's formats, each file once: the most that a frame can ever need, not what
one does.

A kind may have more to tell: its module ``<kind>_info``, found by the kind's name, has ``facts(prim)``, what
`PatchInfo` keeps, and ``describe(facts)``, a line for people.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdShade

import fexel
from fexel import homography
from fexel.errors import FexelError
from fexel.images import ImageInfo, image_info
from fexel.schema.definition import parts_of
from fexel.schema.wrapper import is_a
from fexel.schema.zipmap import patches_of
from fexel.stage import open_stage
from fexel.textures import texture_kind

__all__ = ["PartsInfo", "PatchInfo", "TextureInfo", "inspect_stage", "texture_roots", "zipmap_roots"]


@dataclass(frozen=True)
class PartsInfo:
    """Files of a texture's parts of one type: child prims that are no textures themselves.

    Attributes
    ----------
    type : str
        Schema name.
    files : int
        Each counted once.
    smallest, largest : (int, int) or None
        Texels of the file with the fewest and the most; None when no file can be read.
    bytes_on_disk, bytes_resident : int
    """

    type: str
    files: int
    smallest: tuple[int, int] | None
    largest: tuple[int, int] | None
    bytes_on_disk: int
    bytes_resident: int


@dataclass(frozen=True)
class PatchInfo:
    """One texture of a nest.

    Attributes
    ----------
    path : str
        Prim path.
    type : str
        Schema name.
    depth : int
        0 for the root.
    file : str
        As authored.
    width, height : int or None
        Texels; None when the file cannot be read.
    gain : float or None
        Texels per root texel along an axis; 1 for the root.
    opacity : float
    bytes_on_disk, bytes_resident : int
        Of all its files, whether or not another patch has the same.
    others : dict of str to (int, int) or None
        Its other files by the input that names them, such as ``mask`` and ``pinchmap``, or by the child that does
        (``leaf.file``): texels, None when unreadable.
    problem : str
        What is wrong with a file, or ''.
    parts : tuple of PartsInfo
        Those of `others` that child prims name, summed up.
    facts : dict
        What its kind tells besides, see `fexel_tools.umbrella_info`; empty when it has nothing to tell.
    description : str
        `facts` as a line for people.
    """

    path: str
    type: str
    depth: int
    file: str
    width: int | None
    height: int | None
    gain: float | None
    opacity: float
    bytes_on_disk: int
    bytes_resident: int
    others: dict[str, tuple[int, int] | None]
    problem: str = ""
    parts: tuple[PartsInfo, ...] = ()
    facts: dict[str, Any] = field(default_factory=dict)
    description: str = ""


@dataclass(frozen=True)
class TextureInfo:
    """A root texture with its patches.

    Attributes
    ----------
    path : str
    patches : tuple of PatchInfo
        The root first, in draw order.
    depth : int
        Deepest nesting level.
    largest_gain : float
    bytes_on_disk, bytes_resident : int
        Each file counted once.
    fallback : str
        File that other applications show, or ''.
    fallback_size : (int, int) or None
    """

    path: str
    patches: tuple[PatchInfo, ...]
    depth: int
    largest_gain: float
    bytes_on_disk: int
    bytes_resident: int
    fallback: str = ""
    fallback_size: tuple[int, int] | None = None


@dataclass(frozen=True)
class _File:
    info: ImageInfo | None
    disk: int
    resident: int
    problem: str


def inspect_stage(stage: str | Path | Usd.Stage) -> tuple[TextureInfo, ...]:
    """Describe every texture of a stage that is not a patch of another.

    Parameters
    ----------
    stage : path or Usd.Stage

    Raises
    ------
    FexelError
        The stage cannot be opened. A missing or damaged image is not an error but a `PatchInfo.problem`.
    """
    opened = stage if isinstance(stage, Usd.Stage) else open_stage(stage)
    return tuple(_inspect_texture(root) for root in texture_roots(opened))


def texture_roots(stage: Usd.Stage) -> list[Usd.Prim]:
    """The FexelTextures of a stage that are not patches of another texture, in stage order."""
    roots = []
    prims = iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    for prim in prims:
        if is_a(prim, "FexelTexture"):
            roots.append(prim)
            prims.PruneChildren()
    return roots


def zipmap_roots(stage: Usd.Stage) -> list[fexel.ZipmapTexture]:
    """Those of `texture_roots` that are ZipmapTextures."""
    return [texture for prim in texture_roots(stage) if (texture := fexel.ZipmapTexture(prim))]


def _inspect_texture(root: Usd.Prim) -> TextureInfo:
    files: dict[str, _File] = {}
    entries: list[PatchInfo] = []
    for patch in patches_of(root):
        entries.append(_inspect_patch(patch, entries, files))
    fallback, fallback_size = _fallback(root)
    return TextureInfo(
        path=str(root.GetPath()),
        patches=tuple(entries),
        depth=max((p.depth for p in entries), default=0),
        largest_gain=max((p.gain for p in entries if p.gain is not None), default=1.0),
        bytes_on_disk=sum(f.disk for f in files.values()),
        bytes_resident=sum(f.resident for f in files.values()),
        fallback=fallback,
        fallback_size=fallback_size,
    )


def _inspect_patch(patch: fexel.Patch, before: list[PatchInfo], files: dict[str, _File]) -> PatchInfo:
    authored, file = _file(patch.prim.GetAttribute("inputs:file"), files)
    others = {name: _file(attribute, files) for name, attribute in _other_files(patch.prim).items()}
    size = (file.info.width, file.info.height) if file.info else (None, None)
    problems = [f"{name} {path}: {other.problem}" for name, (path, other) in others.items() if other.problem]
    kind_info = _kind_info(texture_kind(patch.prim) or "")
    facts = kind_info.facts(patch.prim) if kind_info else {}
    return PatchInfo(
        path=str(patch.path),
        type=str(patch.prim.GetTypeName()),
        depth=patch.depth,
        file=authored,
        width=size[0],
        height=size[1],
        gain=_gain(patch, size, before),
        opacity=patch.opacity,
        bytes_on_disk=file.disk + sum(other.disk for _, other in others.values()),
        bytes_resident=file.resident + sum(other.resident for _, other in others.values()),
        others={name: (o.info.width, o.info.height) if o.info else None for name, (_, o) in others.items()},
        problem=file.problem or "; ".join(problems),
        parts=_parts(patch.prim, files),
        facts=facts,
        description=kind_info.describe(facts) if kind_info else "",
    )


@functools.cache
def _kind_info(kind: str) -> ModuleType | None:
    """The module in which a kind tells more of its textures."""
    name = f"fexel_tools.{kind}_info"
    return importlib.import_module(name) if importlib.util.find_spec(name) else None


def _parts(prim: Usd.Prim, files: dict[str, _File]) -> tuple[PartsInfo, ...]:
    found: dict[str, dict[str, _File]] = {}
    for part in parts_of(prim):
        for attribute in _assets(part):
            path, file = _file(attribute, files)
            found.setdefault(str(part.GetTypeName()), {})[attribute.Get().resolvedPath or path] = file
    return tuple(_summed(name, list(each.values())) for name, each in found.items())


def _summed(name: str, files: list[_File]) -> PartsInfo:
    sizes = sorted(((f.info.width, f.info.height) for f in files if f.info), key=lambda size: size[0] * size[1])
    return PartsInfo(
        type=name,
        files=len(files),
        smallest=sizes[0] if sizes else None,
        largest=sizes[-1] if sizes else None,
        bytes_on_disk=sum(f.disk for f in files),
        bytes_resident=sum(f.resident for f in files),
    )


def _other_files(prim: Usd.Prim) -> dict[str, Usd.Attribute]:
    """Attributes besides ``inputs:file`` by which a texture and its parts name files, by what to call them."""
    attributes = {a.GetBaseName(): a for a in _assets(prim) if a.GetBaseName() != "file"}
    for part in parts_of(prim):
        name = part.GetPath().MakeRelativePath(prim.GetPath())
        attributes |= {f"{name}.{attribute.GetBaseName()}": attribute for attribute in _assets(part)}
    return attributes


def _assets(prim: Usd.Prim) -> list[Usd.Attribute]:
    """Authored attributes that name a file."""
    assets = [a for a in prim.GetAuthoredAttributes() if a.GetTypeName() == Sdf.ValueTypeNames.Asset]
    return [a for a in assets if getattr(a.Get(), "path", "")]


def _gain(patch: fexel.Patch, size: tuple[int | None, int | None], before: list[PatchInfo]) -> float | None:
    if not before:
        return 1.0
    root = before[0]
    width, height = size
    if not (width and height and root.width and root.height) or not homography.is_usable(patch.root_to_patch):
        return None
    centre = homography.apply(np.linalg.inv(patch.root_to_patch), np.array([[0.5, 0.5]]))
    jacobian = homography.jacobian(homography.normalize(patch.root_to_patch), centre)[0]
    area = abs(np.linalg.det(jacobian)) * width * height / (root.width * root.height)
    return float(np.sqrt(area)) if np.isfinite(area) else None


def _file(attribute: Usd.Attribute, files: dict[str, _File]) -> tuple[str, _File]:
    value = attribute.Get() if attribute else None
    if value is None or not value.path:
        return "", _File(None, 0, 0, "")
    key = value.resolvedPath or value.path
    if key not in files:
        files[key] = _read(value.resolvedPath)
    return value.path, files[key]


def _read(resolved: str) -> _File:
    if not resolved:
        return _File(None, 0, 0, "missing")
    try:
        info = image_info(resolved)
        disk = Path(resolved).stat().st_size
    except FexelError as error:
        return _File(None, 0, 0, str(error).removeprefix(f"{resolved}: "))
    except OSError:  # inside a package: the size of the file alone cannot be told
        disk = 0
    return _File(info, disk, _resident_bytes(info), "")


def _resident_bytes(info: ImageInfo) -> int:
    """All mip levels, RGBA: 8 bits per channel for 8-bit files, 16 for the others."""
    texels, width, height = 0, info.width, info.height
    while True:
        texels += width * height
        if width == height == 1:
            return texels * (4 if info.dtype == "uint8" else 8)
        width, height = max(1, width // 2), max(1, height // 2)


def _fallback(root: Usd.Prim) -> tuple[str, tuple[int, int] | None]:
    output = UsdShade.NodeGraph(root).GetOutput("rgb")
    source = output.GetConnectedSources()[0] if output else []
    shader = UsdShade.Shader(source[0].source.GetPrim()) if source else None
    if not shader or not shader.GetInput("file"):
        return "", None
    value = shader.GetInput("file").Get()
    if value is None or not value.path:
        return "", None
    try:
        info = image_info(value.resolvedPath or value.path)
    except FexelError:
        return value.path, None
    return value.path, (info.width, info.height)
