"""Photos to a zipmap stage: the whole way, section 4 of Eisemann and Magnor 2010, *Zipmaps*.

1. `photos`: probe every file; an unreadable one is rejected, the run goes on.
2. `photo_links`: register photos pair by pair.
3. `photo_graph`: root, poses of all photos together, what each adds.
4. `patches`: colours, masks, textures.
5. `zipmap_stage`: prims, material, surface, cameras; `fallback`: the picture for applications without our plugin.

All output appears at once at the end (`staged_output`). The artist's way (`layout`) enters at step 4.
"""

from __future__ import annotations

import re
import unicodedata
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fexel.errors import FexelError, FexelWarning
from fexel_tools import zipmap_stage
from fexel_tools.coverage import MIN_GAIN, polygon_area
from fexel_tools.framing import camera_poses
from fexel_tools.geometry import PRIMITIVES, Surface, load_surface, primitive, reference_source
from fexel_tools.patches import PatchJob, write_textures
from fexel_tools.photo_graph import PhotoGraph, build_graph, link_error_px
from fexel_tools.photo_links import find_links
from fexel_tools.photos import Photo, probe_photo
from fexel_tools.progress import Progress, silent
from fexel_tools.report import PhotoReport, ZipmapReport, write_report
from fexel_tools.staged_output import StagedOutput, check_output, staged_output

__all__ = ["PlannedPatch", "ZipmapOptions", "author_stage", "check_options", "make_zipmap", "prim_names"]


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
    max_error_px: float = float("inf")
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


def make_zipmap(
    files: list[str],
    out: str | Path,
    options: ZipmapOptions | None = None,
    *,
    report: str | Path | None = None,
    progress: Progress | None = None,
) -> ZipmapReport:
    """Author a zipmap stage from unordered photos of one surface.

    Parameters
    ----------
    files : list of str
        Photos, any format that OpenImageIO reads.
    out : str or Path
        ``.usda``, ``.usdc`` or ``.usd``; textures go to the folder ``<stem>_textures`` beside it.
    options : ZipmapOptions, optional
    report : str or Path, optional
        JSON file, see `fexel_tools.report`.
    progress : callable(step, done, total), optional

    Returns
    -------
    ZipmapReport

    Raises
    ------
    FexelError
        A file is missing, an option is wrong, the output cannot be written, or no photo is usable. Nothing is written
        then.

    Examples
    --------
    >>> report = make_zipmap(["wall.jpg", "door.jpg"], "wall.usda")  # doctest: +SKIP
    >>> [photo.status for photo in report.photos]  # doctest: +SKIP
    ['root', 'patch']
    """
    options = options or ZipmapOptions()
    step = progress or silent
    files = [str(f) for f in files]
    root = _check_input(files, options, report)
    surface = check_options(out, options)
    photos, unusable = _probe_all(files)
    if root is not None and root in unusable:
        raise FexelError(f"{unusable[root]} (asked for as root)")
    links, more = find_links(photos, unusable, jobs=options.jobs, progress=step)
    unusable = {**{k: _reason(files[k], v) for k, v in unusable.items()}, **more}
    sizes = [(p.width, p.height) if p else (0, 0) for p in photos]
    graph = build_graph(
        files,
        sizes,
        links,
        root=root,
        unusable=unusable,
        max_error_px=options.max_error_px,
        min_gain=options.min_gain,
    )
    root_patch, patches = _plan(photos, graph, options)
    result = _report(files, graph)
    author_stage(out, root_patch, patches, options, surface=surface, progress=step)
    if report:
        write_report(result, report)
    return result


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
        if surface.source:
            reference_source(stage.GetRootLayer(), "/World/Surface", surface, Path(out).parent)
        stage.GetRootLayer().Save()
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


def check_options(out: str | Path, options: ZipmapOptions) -> Surface | None:
    """Find wrong options before any work is done, and read the mesh if there is one.

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
    check_output(out)
    return load_surface(options.mesh) if options.mesh else None


def _check_input(files: list[str], options: ZipmapOptions, report: str | Path | None) -> int | None:
    """What can be known to fail before any work is done; returns the number of the root asked for."""
    if not files:
        raise FexelError("no photo given, expected at least one")
    missing = [f for f in files if not Path(f).exists()]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise FexelError(f"{missing[0]}: no such file{more}")
    if report is not None and not Path(report).absolute().parent.is_dir():
        raise FexelError(f"{report}: the folder {Path(report).parent} does not exist")
    return _find_root(files, options.root) if options.root else None


def _find_root(files: list[str], root: str) -> int:
    wanted = Path(root)
    for test in (lambda f: f == root, lambda f: Path(f).resolve() == wanted.resolve(), lambda f: Path(f).name == root):
        found = [k for k, f in enumerate(files) if test(f)]
        if found:
            return found[0]
    raise FexelError(f"--root {root}: is not among the photos")


def _probe_all(files: list[str]) -> tuple[list[Photo | None], dict[int, str]]:
    photos: list[Photo | None] = []
    unusable = {}
    for k, file in enumerate(files):
        try:
            photos.append(probe_photo(file))
        except FexelError as error:
            photos.append(None)
            unusable[k] = str(error)
    return photos, unusable


def _reason(file: str, message: str) -> str:
    return message.removeprefix(f"{file}: ")


def _plan(
    photos: list[Photo | None], graph: PhotoGraph, options: ZipmapOptions
) -> tuple[PlannedPatch, list[PlannedPatch]]:
    names = dict(enumerate(prim_names([p.file if p else "" for p in photos])))
    root_photo = photos[graph.root]
    root = PlannedPatch("root", "", root_photo, (0, 0, root_photo.width, root_photo.height))
    patches = [
        PlannedPatch(
            name=names[a.photo],
            parent="" if a.parent == graph.root else names[a.parent],
            photo=photos[a.photo],
            window=a.window,
            root_from_photo=graph.poses[a.photo],
            tau=options.tau,
            match_colors=options.match_colors,
        )
        for a in graph.patches
    ]
    return root, patches


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
):
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
    import shutil

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


def _report(files: list[str], graph: PhotoGraph) -> ZipmapReport:
    additions = {a.photo: a for a in graph.patches}
    entries = []
    for k, file in enumerate(files):
        if k == graph.root:
            entries.append(PhotoReport(file, "root", "", None, 1.0, np.eye(3), 0, 0.0))
        elif k in additions:
            entries.append(_patch_report(files, graph, k, additions[k]))
        else:
            entries.append(PhotoReport(file, "rejected", graph.rejected[k], root_from_photo=graph.poses.get(k)))
    for link in graph.dropped:
        pair = f"'{files[link.fine]}' and '{files[link.coarse]}'"
        warnings.warn(f"match of {pair} contradicts the others and is left out", FexelWarning, stacklevel=3)
    return ZipmapReport(files[graph.root], tuple(entries))


def _patch_report(files: list[str], graph: PhotoGraph, photo: int, addition) -> PhotoReport:
    own = [link for link in graph.links if link.fine == photo] or [
        link for link in graph.links if photo in (link.coarse, link.fine)
    ]
    link = min(own, key=lambda item: (item.coarse != addition.parent, link_error_px(item, graph.poses)))
    parent_scale = next((a.scale for a in graph.patches if a.photo == addition.parent), 1.0)
    return PhotoReport(
        file=files[photo],
        status="patch",
        parent=files[addition.parent],
        scale=addition.scale / parent_scale,
        root_from_photo=graph.poses[photo],
        inliers=link.inliers,
        rms_px=link_error_px(link, graph.poses),
    )
