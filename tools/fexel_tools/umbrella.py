"""Photos to a ground of umbrellas: the whole way, section 3 of *Just-in-time texture synthesis* (2012).

1. `umbrella_solution`: elements, bases, diversification, arrangement, background.
2. `umbrella_companions`: normal and roughness maps of the same elements.
3. `umbrella_textures`, `umbrella_stage`: files and prims.
4. `umbrella_levels`, `umbrella_merge`: levels of detail; `fallback`: the picture for other applications.
5. `umbrella_storage`, `umbrella_sheet`: what it costs and what it is made of, if a report or a sheet is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from pxr import Usd

import fexel
from fexel.errors import FexelError
from fexel.textures import extract_texture
from fexel.textures.umbrella import level_digest
from fexel.textures.umbrella_arrangement import Arrangement
from fexel.textures.umbrella_cells import build_cells, cell_statistics
from fexel_tools import fallback, umbrella_stage
from fexel_tools.baking import texture_baker
from fexel_tools.phases import Phases
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report
from fexel_tools.staged_output import StagedOutput, check_output, staged_output
from fexel_tools.umbrella_companions import MapData, check_companions, companion_maps, main_map
from fexel_tools.umbrella_levels import image_level, write_level_image
from fexel_tools.umbrella_options import UmbrellaOptions, check_options, read_files
from fexel_tools.umbrella_raster import rasterize
from fexel_tools.umbrella_report import BaseReport, DroppedReport, UmbrellaReport
from fexel_tools.umbrella_sheet import SheetInput, write_sheet
from fexel_tools.umbrella_solution import STEPS, Ground, compute_ground, read_sources
from fexel_tools.umbrella_storage import compressed_sizes, explicit_resolution, explicit_words, umbrella_words
from fexel_tools.umbrella_textures import write_background, write_bases

__all__ = ["make_umbrella"]

# Per axis and pixel: edges and shadows by nine samples that share a colour. Against 144 samples with a colour each:
# 40 dB on fall leaves, 38 dB on real ones; with a colour each 46 and 47 dB, in twice the time.
Drawn = Callable[[int, int], None]  # is told tiles done and in all

_FALLBACK_SAMPLES = 3


@dataclass(frozen=True)
class _Written:
    """Bytes on disk of the main texture."""

    textures: int = 0
    arrays: int = 0
    levels: int = 0


def make_umbrella(
    files: Sequence[str],
    out: str | Path,
    options: UmbrellaOptions | None = None,
    *,
    report: str | Path | None = None,
    sheet: str | Path | None = None,
    progress: Progress | None = None,
) -> UmbrellaReport:
    """Author a ground of umbrellas from photos of its elements.

    Parameters
    ----------
    files : sequence of str
        Cut-outs with alpha, objects on a plain ground, or photos of many elements; any format that OpenImageIO reads.
    out : str or Path
        ``.usda``, ``.usdc`` or ``.usd``; textures go to the folder ``<stem>_textures`` beside it.
    options : UmbrellaOptions, optional
    report : str or Path, optional
        JSON file, see `fexel_tools.umbrella_report`.
    sheet : str or Path, optional
        PNG: base umbrellas, their diversification, the arrangement.
    progress : callable(step, done, total), optional

    Returns
    -------
    UmbrellaReport
        Its sizes with both sides compressed, and `k_seen`, only where a report is asked for, as they take a while.

    Raises
    ------
    FexelError
        A file is missing, an option is wrong, no file has a usable element, or an output cannot be written. Nothing is
        written then.

    Examples
    --------
    >>> make_umbrella(["oak.png", "ash.png"], "ground.usda").n  # doctest: +SKIP
    3513
    """
    options = options or UmbrellaOptions()
    files = [str(file) for file in files]
    check_options(options)
    inputs = [*_checked(files), *read_files(options)]
    check_output(out, inputs)
    _check_side_outputs(report, sheet, [out, *inputs])
    phases = Phases("umbrellas", STEPS, progress or silent)
    with phases("read"):
        sources = read_sources(files, options)
        check_companions(sources, options)
    ground = compute_ground(sources, options, phases)
    with phases("textures"):
        maps = [main_map(ground, options), *companion_maps(ground, options)]
    written = _write(ground, maps, files, out, options, phases)
    with phases("measure"):
        made = _report(ground, maps[0], out, written, measured=report is not None)
        shown = SheetInput(ground.arrangement, ground.textures, ground.names, ground.behind, options.is_data)
        if sheet is not None:
            write_sheet(shown, sheet)
    made = replace(made, seconds=phases.authoring, phases=dict(phases.seconds))
    if report is not None:
        write_report(made, report)
    return made


def _checked(files: Sequence[str]) -> list[str]:
    if not files:
        raise FexelError("no image given, expected at least one")
    for file in files:
        if not Path(file).exists():
            raise FexelError(f"{file}: no such file")
        if Path(file).is_dir():
            raise FexelError(f"{file}: is a folder, expected an image")
    return list(files)


def _check_side_outputs(report: str | Path | None, sheet: str | Path | None, others: list[str | Path]) -> None:
    if report is not None:
        check_report(report, others)
    if sheet is not None:
        if Path(sheet).suffix.lower() != ".png":
            raise FexelError(f"{sheet}: the sheet is a '{Path(sheet).suffix}', expected a .png")
        check_report(sheet, [*others, *([report] if report is not None else [])], "sheet")


def _write(
    ground: Ground,
    maps: Sequence[MapData],
    files: Sequence[str],
    out: str | Path,
    options: UmbrellaOptions,
    phases: Phases,
) -> _Written:
    """Everything into its place."""
    with staged_output(out) as staged:
        with phases("textures"):
            prims, texture_bytes = _write_textures(ground, maps, staged)
        with phases("stage"):
            source = ", ".join(Path(file).name for file in files[:8]) + (", ..." if len(files) > 8 else "")
            stage = umbrella_stage.create_stage(
                staged.stage, staged.textures, ground.arrangement, ground.names, prims, source
            )
            stage.GetRootLayer().Save()
            arrays = next(iter([*staged.textures.glob("*.usdc"), staged.stage])).stat().st_size
        with ThreadPoolExecutor(1) as beside:  # encodes pictures while levels are made
            with phases("fallback"):
                drawn = partial(phases.progress, "fallback")
                encoded = [_write_fallback(stage, each, staged, options, beside, drawn) for each in maps]
            with phases("levels"):
                drawn = partial(phases.progress, "levels")
                level_bytes = [_write_levels(stage, ground, each, staged, options, drawn) for each in maps]
                for picture in encoded:
                    picture.result()
                stage.GetRootLayer().Save()  # levels and fallbacks add to it
    return _Written(texture_bytes, arrays, level_bytes[0])


def _write_textures(
    ground: Ground, maps: Sequence[MapData], staged: StagedOutput
) -> tuple[list[umbrella_stage.UmbrellaMap], int]:
    """Files of all maps, and the bytes of the main one's."""
    prims, sizes = [], []
    for number, each in enumerate(maps):
        suffix = f"_{each.name}" if number else ""
        names = [f"{name}{suffix}" for name in ground.names]
        alphas = [base.has_alpha for base in ground.bases]
        bases = write_bases(staged.textures, names, each.textures, alphas, is_data=each.is_data, bits=each.bits)
        nbytes, background = bases.nbytes, ""
        if each.background.picture is not None:
            behind = write_background(
                staged.textures, each.background.picture, f"background{suffix}", is_data=each.is_data
            )
            nbytes, background = nbytes + behind.nbytes, f"./{staged.textures.name}/{behind.files[0]}"
        prims.append(
            umbrella_stage.UmbrellaMap(
                name=each.name,
                drives=each.drives,
                files=tuple(f"./{staged.textures.name}/{file}" for file in bases.files),
                color_space="raw" if each.is_data else "sRGB",
                background=background,
                background_color=each.fallback_color,
                is_biased=each.is_vectors,
                has_colors=each.has_colors,
            )
        )
        sizes.append(nbytes)
    return prims, sizes[0]


def _write_levels(
    stage: Usd.Stage, ground: Ground, each: MapData, staged: StagedOutput, options: UmbrellaOptions, drawn: Drawn
) -> int:
    """Levels of detail of a map; returns their bytes."""
    if options.levels == "none" or not len(ground.arrangement):
        return 0
    texture = fexel.UmbrellaTexture(stage.GetPrimAtPath(f"{umbrella_stage.MATERIAL_PATH}/{each.name}"))
    _, data = extract_texture(texture.GetPrim(), Usd.TimeCode.Default())
    digest = level_digest(data)
    if options.levels == "merged":
        return _write_merged(texture, each, digest, staged, options)
    image = image_level(
        each.arrangement,
        each.textures,
        each.behind,
        jobs=options.jobs,
        vector_scale=each.vector_scale,
        progress=drawn,
    )
    path = staged.textures / f"{_file_stem('level', each, options)}.tif"
    bits, color_space = (16 if max(each.bits) > 8 else 8), ("raw" if each.is_data else "sRGB")
    write_level_image(path, image, bits=bits, color_space=color_space)
    columns, rows = (max(1, cells >> image.level) for cells in ground.arrangement.grid)
    relative = f"./{staged.textures.name}/{path.name}"
    umbrella_stage.define_level(texture, umbrella_stage.LevelPrim(image.level, (columns, rows), digest, relative))
    return path.stat().st_size


def _write_merged(
    texture: fexel.UmbrellaTexture, each: MapData, digest: str, staged: StagedOutput, options: UmbrellaOptions
) -> int:
    """Merged umbrellas, their arrays in a layer of their own."""
    from fexel_tools.umbrella_merge import merged_levels  # and with it scipy.sparse

    merged = merged_levels(each.arrangement, each.textures, each.behind, jobs=options.jobs)
    if not merged:
        return 0
    levels = [
        umbrella_stage.LevelPrim(number, level.grid, digest, arrangement=level)
        for number, level in enumerate(merged, 1)
    ]
    path = staged.textures / f"{_file_stem('level', each, options)}.usdc"
    umbrella_stage.write_levels(path, levels)
    for level in levels:
        umbrella_stage.define_level(texture, level, f"./{staged.textures.name}/{path.name}")
    return path.stat().st_size


def _write_fallback(
    stage: Usd.Stage, each: MapData, staged: StagedOutput, options: UmbrellaOptions, beside: Executor, drawn: Drawn
) -> Future:
    """The picture of a map for other applications, drawn from what is at hand, and the network that shows it.

    The picture is encoded beside; the result is its end.
    """
    prim = stage.GetPrimAtPath(f"{umbrella_stage.MATERIAL_PATH}/{each.name}")
    kind, data = extract_texture(prim, Usd.TimeCode.Default())
    baker = texture_baker(kind, data, str(prim.GetPath()))
    storage = baker.storage
    picture = rasterize(
        each.arrangement,
        each.textures,
        each.behind,
        baker.size(options.fallback_size),
        supersample=_FALLBACK_SAMPLES,
        group=_FALLBACK_SAMPLES,
        vector_scale=each.vector_scale,
        jobs=options.jobs,
        progress=drawn,
    )
    path = staged.textures / f"{_file_stem('fallback', each, options)}.png"
    fallback.author(prim, path, color_space=storage.color_space, scale=storage.scale, bias=storage.bias)
    return beside.submit(fallback.write_picture, path, picture, storage.color_space, storage.dtype, is_photo=True)


def _file_stem(what: str, each: MapData, options: UmbrellaOptions) -> str:
    return what if each.drives == options.driven else f"{what}_{each.name}"


def _report(ground: Ground, main: MapData, out: str | Path, written: _Written, *, measured: bool) -> UmbrellaReport:
    arrangement = ground.arrangement
    sizes = [(texture.shape[1], texture.shape[0]) for texture in ground.textures]
    opaque = np.array([not base.has_alpha for base in ground.bases])
    cells = cell_statistics(arrangement, opaque) if measured else None
    # Shadows are no part of k.
    most = cells.most if cells else _longest_list(replace(arrangement, shadow_strength=0.0))
    compressed = None
    if measured and len(arrangement):
        compressed = compressed_sizes(
            main.arrangement, main.textures, main.behind, is_data=main.is_data, vector_scale=main.vector_scale
        )
    return UmbrellaReport(
        stage=str(out),
        bases=tuple(_base_report(ground, number) for number in range(len(ground.bases))),
        k=most,
        k_seen=cells.most_seen if cells else None,
        n=len(arrangement),
        grid=arrangement.grid,
        words=umbrella_words(arrangement, sizes, most),
        explicit=explicit_words(arrangement, sizes),
        resolution=explicit_resolution(arrangement, sizes),
        texture_bytes=written.textures,
        array_bytes=written.arrays,
        level_bytes=written.levels,
        seconds=0.0,
        compressed=compressed,
        dropped=tuple(_dropped(ground)),
    )


def _longest_list(arrangement: Arrangement) -> int:
    """Most umbrellas that touch a cell."""
    return int(build_cells(arrangement, arrangement.grid, cull=False).counts.max())


def _base_report(ground: Ground, number: int) -> BaseReport:
    base, element = ground.bases[number], ground.elements[number]
    height, width = base.texture.shape[:2]
    return BaseReport(
        name=ground.names[number],
        file=str(element.path),
        vertices=len(base.points),
        texture=(width, height),
        lost_area=base.lost_area,
        tolerance_px=base.tolerance_px,
        quality=element.quality,
    )


def _dropped(ground: Ground) -> list[DroppedReport]:
    found = []
    for source in ground.sources:
        if not source.elements:
            found.append(DroppedReport(str(source.path), None, source.reason or "no element found"))
        found += [DroppedReport(str(source.path), box, reason) for box, reason in source.dropped]
    return found
