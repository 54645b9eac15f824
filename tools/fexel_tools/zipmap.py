"""Photos to a zipmap stage: the whole way, section 4 of Eisemann and Magnor 2010, *Zipmaps*.

1. `photos`: probe every file; an unreadable one is rejected, the run goes on.
2. `photo_links`: register photos pair by pair.
3. `photo_graph`: root, poses of all photos together, what each adds.
4. `authoring`: colours, masks, textures, stage, fallback. The artist's way (`layout`) enters here.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np

from fexel.errors import FexelError, FexelWarning
from fexel_tools.authoring import PlannedPatch, ZipmapOptions, author_stage, check_options, prim_names
from fexel_tools.coverage import Addition
from fexel_tools.photo_graph import PhotoGraph, build_graph
from fexel_tools.photo_links import find_links
from fexel_tools.photos import Photo, probe_photo
from fexel_tools.progress import Progress, silent
from fexel_tools.report import PhotoReport, ZipmapReport, check_report, write_report

__all__ = ["make_zipmap"]


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
    root = _check_input(files, options)
    if report is not None:
        check_report(report, [out, *files])
    surface = check_options(out, options, files)
    photos, unusable = _probe_all(files)
    if root is not None and root in unusable:
        raise FexelError(f"{unusable[root]} (asked for as root)")
    found = find_links(photos, unusable, max_error_px=options.max_error_px, jobs=options.jobs, progress=step)
    unusable = {**{k: _reason(files[k], v) for k, v in unusable.items()}, **found.rejected}
    sizes = [(p.width, p.height) if p else (0, 0) for p in photos]
    graph = build_graph(
        files,
        sizes,
        found.links,
        root=root,
        failures=found.failures,
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


def _check_input(files: list[str], options: ZipmapOptions) -> int | None:
    """What can be known to fail before any work is done; returns the number of the root asked for."""
    if not files:
        raise FexelError("no photo given, expected at least one")
    missing = [f for f in files if not Path(f).exists()]
    if missing:
        more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        raise FexelError(f"{missing[0]}: no such file{more}")
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


def _patch_report(files: list[str], graph: PhotoGraph, photo: int, addition: Addition) -> PhotoReport:
    mine = [k for k, link in enumerate(graph.links) if photo in (link.coarse, link.fine)]
    best = min(mine, key=lambda k: (graph.links[k].fine != photo, graph.links[k].coarse != addition.parent))
    parent_scale = next((a.scale for a in graph.patches if a.photo == addition.parent), 1.0)
    return PhotoReport(
        file=files[photo],
        status="patch",
        parent=files[addition.parent],
        scale=addition.scale / parent_scale,
        root_from_photo=graph.poses[photo],
        inliers=graph.links[best].inliers,
        rms_px=graph.errors_px[best],
    )
