"""From a finished plan (which photo goes where) to a stage with its textures.

The plan comes from registration (`zipmap`) or from a layout by hand (`layout`); from here on both take the same way:
textures (`patches`), prims, material, surface and cameras (`zipmap_stage`, `framing`), fallback. All output appears
at once at the end (`staged_output`).
"""

from __future__ import annotations

import re
import shutil
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pxr import Sdf, Usd

from fexel.errors import FexelError
from fexel_tools import zipmap_stage
from fexel_tools.coverage import MIN_GAIN, polygon_area
from fexel_tools.framing import camera_poses
from fexel_tools.geometry import PRIMITIVES, Surface, load_surface, primitive, reference_source
from fexel_tools.patches import PatchJob, write_textures
from fexel_tools.photos import Photo
from fexel_tools.progress import Progress, silent
from fexel_tools.staged_output import StagedOutput, check_output, staged_output

__all__ = ["PlannedPatch", "ZipmapOptions", "author_stage", "check_options", "prim_names"]


DEFAULT_MAX_ERROR_PX = 8.0  # a facade with its relief stays below; patches then fit visibly less well


@dataclass(frozen=True)
class ZipmapOptions:
    """How to author; the defaults are those of the command line.

    Attributes
    ----------
    root : str
        The root photo, as given among the photos; '' chooses.
    max_error_px : float
        Photos whose residual is larger are rejected; pixels of the coarser photo of a pair.
    tau : float or None
        Threshold of eq. (3); None is automatic.
    fallback_size : int
        Longer side of the fallback image, pixels.
    primitive : str
        One of `geometry.PRIMITIVES`.
    mesh : str
        Mesh file used instead of the primitive.
    bits : int
        8, 16, or 0: 16 for photos of more than 8 bits. Float photos become half-float EXR unless 8 or 16 is asked for.
    jobs : int
        Threads.
    min_gain : float
        Least gain in resolution that makes a patch.
    match_colors : bool
        Exposure, white balance and Poisson equation.
    """

    root: str = ""
    max_error_px: float = DEFAULT_MAX_ERROR_PX
    tau: float | None = None
    fallback_size: int = 2048
    primitive: str = "quad"
    mesh: str = ""
    bits: int = 0
    jobs: int = 2
    min_gain: float = MIN_GAIN
    match_colors: bool = True


@dataclass(frozen=True, eq=False)
class PlannedPatch:
    """A texture of the nest before it is made.

    Attributes
    ----------
    name : str
        Prim and file name, unique.
    parent : str
        '' for patches of the root.
    photo : Photo
    window : (x0, y0, x1, y1)
        Pixels of the photo.
    root_from_photo : (3, 3) float64
    mask : str
        File of the artist's mask; '' for the automatic one.
    opacity : float
    tau : float or None
    match_colors : bool
    """

    name: str
    parent: str
    photo: Photo
    window: tuple[int, int, int, int]
    root_from_photo: np.ndarray = field(default_factory=lambda: np.eye(3))
    mask: str = ""
    opacity: float = 1.0
    tau: float | None = None
    match_colors: bool = True


def author_stage(
    out: str | Path,
    root: PlannedPatch,
    patches: list[PlannedPatch],
    options: ZipmapOptions,
    *,
    surface: Surface | None = None,
    progress: Progress | None = None,
) -> None:
    """Write textures, stage and fallback from a finished plan.

    Parameters
    ----------
    out : str or Path
    root : PlannedPatch
    patches : list of PlannedPatch
        In draw order: parents before children, what lies below before what lies above.
    options : ZipmapOptions
    surface : Surface, optional
        Default: the primitive of the options, sized to the root.
    progress : callable, optional
    """
    from fexel_tools import fallback

    aspect = root.photo.width / root.photo.height
    surface = surface or primitive(options.primitive, aspect)
    step = progress or silent
    with staged_output(out) as staged:
        jobs = [_job(staged, p, options) for p in [root, *patches]]
        finished: list[PatchJob] = []
        step("colours and textures", 0, len(jobs))

        def done(job: PatchJob) -> None:
            finished.append(job)
            step("colours and textures", len(finished), len(jobs))

        write_textures(jobs, options.jobs, done)
        stage = _define(staged, root, patches, jobs, surface, aspect)
        step("fallback", 0, 1)
        texture = stage.GetPrimAtPath(zipmap_stage.TEXTURE_PATH)
        fallback.write_fallback(texture, staged.textures / "fallback.png", options.fallback_size)
        stage.GetRootLayer().Save()
        del stage, texture  # what is authored next is relative to `out`, where no stage may look for it yet
        if surface.source:
            layer = Sdf.Layer.FindOrOpen(str(staged.stage))
            reference_source(layer, "/World/Surface", surface, Path(out).parent)
            layer.Save()
        step("fallback", 1, 1)


def prim_names(files: list[str]) -> list[str]:
    """A prim and file name for each photo: ASCII, a valid identifier, unique without regard to case.

    Examples
    --------
    >>> prim_names(["a/Tür 1.jpg", "b/Tür 1.png", "7.tif", "'.jpg"])
    ['Tur_1', 'Tur_1_2', 'photo_7', 'photo']
    """
    names: list[str] = []
    taken = {"texture", "surface", "fallback", "root"}
    for file in files:
        ascii_stem = unicodedata.normalize("NFKD", Path(file).stem).encode("ascii", "ignore").decode()
        stem = re.sub(r"[^A-Za-z0-9_]+", "_", ascii_stem).strip("_")[:64] or "photo"
        stem = stem if not stem[0].isdigit() else f"photo_{stem}"
        name, number = stem, 2
        while name.lower() in taken:
            name, number = f"{stem}_{number}", number + 1
        taken.add(name.lower())
        names.append(name)
    return names


def check_options(out: str | Path, options: ZipmapOptions, inputs: Iterable[str | Path] = ()) -> Surface | None:
    """Find wrong options before any work is done, and read the mesh if there is one.

    Parameters
    ----------
    out : str or Path
    options : ZipmapOptions
    inputs : iterable of str or Path
        Files that are read, other than the mesh: the output must not replace them.

    Raises
    ------
    FexelError
        An option out of range, an output that cannot be written, or an unusable mesh.
    """
    if options.bits not in (0, 8, 16):
        raise FexelError(f"--bits: {options.bits}, expected 8 or 16")
    if options.primitive not in PRIMITIVES:
        raise FexelError(f"--primitive: '{options.primitive}' is unknown, expected one of {', '.join(PRIMITIVES)}")
    if options.tau is not None and not (np.isfinite(options.tau) and options.tau > 0.0):
        raise FexelError(f"--tau: {options.tau}, expected a positive number")
    if options.fallback_size < 1:
        raise FexelError(f"--fallbackSize: {options.fallback_size}, expected at least 1 pixel")
    if not options.max_error_px > 0.0:
        raise FexelError(f"--max-error: {options.max_error_px}, expected a positive number of pixels")
    if not options.min_gain >= 0.0:
        raise FexelError(f"--min-gain: {options.min_gain}, expected a number that is not negative")
    if options.jobs < 1:
        raise FexelError(f"--jobs: {options.jobs}, expected at least 1")
    check_output(out, [*inputs, *([options.mesh] if options.mesh else [])])
    return load_surface(options.mesh) if options.mesh else None


def _job(staged: StagedOutput, patch: PlannedPatch, options: ZipmapOptions) -> PatchJob:
    bits: int | str = options.bits or {"uint8": 8, "uint16": 16}.get(patch.photo.pixel_type, "half")
    extension = ".exr" if bits == "half" else ".tif"
    return PatchJob(
        photo=patch.photo,
        window=patch.window,
        root_from_photo=patch.root_from_photo,
        file=staged.textures / f"{patch.name}{extension}",
        bits=bits,
        is_root=patch.name == "root",
        match_colors=patch.match_colors,
        blend=not patch.mask,
        tau=patch.tau,
        opacity=patch.opacity,
    )


def _define(
    staged: StagedOutput,
    root: PlannedPatch,
    patches: list[PlannedPatch],
    jobs: list[PatchJob],
    surface: Surface,
    aspect: float,
) -> Usd.Stage:
    st_from_root = {}
    prims = []
    for patch, job in zip([root, *patches], jobs, strict=True):
        key = "" if patch is root else patch.name
        st_from_root[key] = zipmap_stage.st_from_pixels(patch.window) @ np.linalg.inv(patch.root_from_photo)
        prims.append(
            zipmap_stage.PatchPrim(
                name=patch.name,
                parent=patch.parent,
                file=f"./{staged.textures.name}/{job.file.name}",
                source_color_space=job.color_space,
                parent_to_child=zipmap_stage.st_matrix(st_from_root[patch.parent], st_from_root[key]),
                mask=_copy_mask(staged, patch),
                opacity=patch.opacity,
                source=Path(patch.photo.file).name,
            )
        )
    detail = _sharpest(root, patches)
    cameras = camera_poses(surface, detail, aspect, zipmap_stage.FRAMES)
    return zipmap_stage.create_stage(staged.stage, prims[0], prims[1:], surface, cameras, aspect)


def _copy_mask(staged: StagedOutput, patch: PlannedPatch) -> str:
    if not patch.mask:
        return ""
    name = f"{patch.name}_mask{Path(patch.mask).suffix.lower()}"
    try:
        shutil.copyfile(patch.mask, staged.textures / name)
    except OSError as error:
        raise FexelError(f"{patch.mask}: mask cannot be read: {error.strerror}") from error
    return f"./{staged.textures.name}/{name}"


def _sharpest(root: PlannedPatch, patches: list[PlannedPatch]) -> np.ndarray | None:
    """Outline in the root's st of the patch with the most pixels per root pixel; None without patches.

    Slivers are passed over: a quarter of the largest patch's pixels is the least.
    """
    pixels = {p.name: (p.window[2] - p.window[0]) * (p.window[3] - p.window[1]) for p in patches}
    large = [p for p in patches if 4 * pixels[p.name] >= max(pixels.values())]
    outlines = {p.name: zipmap_stage.outline_in_root(p.window, p.root_from_photo) for p in large}
    best = max(large, key=lambda p: pixels[p.name] / max(polygon_area(outlines[p.name]), 1e-300), default=None)
    if best is None:
        return None
    st_from_root = zipmap_stage.st_from_pixels((0, 0, root.photo.width, root.photo.height))
    return np.column_stack([outlines[best.name], np.ones(4)]) @ st_from_root.T[:, :2]
