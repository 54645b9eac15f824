"""`fexel minify`: a minification filter for the textures of any stage, as a thin layer over it.

The stage is left as it is, whether its textures are fexel's or plain UsdUVTexture shaders: the layer applies
TextureMinificationAPI to them and authors what was asked for, nothing else. The report is JSON::

    {"stage", "output", "textures": [{"prim", "filter", "variant", "note", "predicted_db": {token: dB}}]}

`filter` is null where the texture's own is left alone; `variant` says which variants show the texture, '' for those
that the stage selects; `note` what one should know. `predicted_db` is of ``--filter auto``: the peak signal-to-noise
ratio to expect of each filter in the picture where it is worst, empty where nothing can be foretold.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pxr import Gf, Sdf, Usd

from fexel.errors import FexelError
from fexel.filters import PORTABLE_FILTERS
from fexel.schema.minification import TextureMinificationAPI
from fexel.stage import open_stage
from fexel_tools.minify_auto import BOUND_DB, UNSEEN, FilterChoice, choose_filter, unjudged
from fexel_tools.minify_textures import FoundTexture, each_texture, holds_data
from fexel_tools.minify_views import SeenFootprints, seen_footprints
from fexel_tools.progress import Progress, silent
from fexel_tools.report import check_report, write_report
from fexel_tools.stage_overlay import StageOverlay, check_overlay

__all__ = ["AUTO", "MinifiedTexture", "MinifyOptions", "MinifyReport", "minify"]

AUTO = "auto"
"""For each texture the cheapest of the portable filters that is good enough."""

_NAMESPACE = "minification:"
_WIDEST = 65536
_DATA_KEEP = "holds data: contrast, brightness and attenuation are for colours (name it by --prim to have them)"


@dataclass(frozen=True)
class MinifyOptions:
    """What is authored; None leaves what the textures have.

    Attributes
    ----------
    filter : str, optional
        ``mipmap``, ``anisotropic``, ``ripmap`` or ``fipmap``; ``auto`` chooses among them, see `minify_auto`.
    contrast, brightness : float, optional
        s and o of ``s c + o``, linear.
    attenuation_distance : float, optional
        Scene units, > 0; infinity takes attenuation away.
    attenuation_color : 3 floats, optional
        Linear Rec.709, >= 0.
    prims : tuple of str
        Only textures at or below these paths; none: all.
    bound_db : float
        Of ``auto``: predicted peak signal-to-noise ratio that is good enough.
    width : int
        Of ``auto``: of the pictures that are meant, pixels.
    """

    filter: str | None = None
    contrast: float | None = None
    brightness: float | None = None
    attenuation_distance: float | None = None
    attenuation_color: tuple[float, float, float] | None = None
    prims: tuple[str, ...] = ()
    bound_db: float = BOUND_DB
    width: int = 960


@dataclass(frozen=True)
class MinifiedTexture:
    """What became of one texture; see the module for the fields."""

    prim: str
    filter: str | None
    variant: str = ""
    note: str = ""
    predicted_db: dict[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """The texture's entry."""
        return {
            "prim": self.prim,
            "filter": self.filter,
            "variant": self.variant,
            "note": self.note,
            "predicted_db": {token: round(value, 2) for token, value in self.predicted_db.items()},
        }


@dataclass(frozen=True)
class MinifyReport:
    """What became of all textures, in namespace order, those of unselected variants last."""

    stage: str
    output: str
    textures: tuple[MinifiedTexture, ...]

    def as_json(self) -> dict[str, Any]:
        """The whole report."""
        return {"stage": self.stage, "output": self.output, "textures": [t.as_json() for t in self.textures]}


def minify(
    source: str | os.PathLike[str],
    output: str | os.PathLike[str],
    options: MinifyOptions,
    *,
    report: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> MinifyReport:
    """Write a layer over a stage that applies TextureMinificationAPI to its textures.

    Parameters
    ----------
    source : path-like
        A USD stage of any format, ``.usdz`` among them.
    output : path-like
        Layer to write, ``.usda``, ``.usdc`` or ``.usd``; written beside and renamed.
    options : MinifyOptions
    report : path-like, optional
        JSON file to write, see the module.
    progress : callable(step, done, total), optional

    Returns
    -------
    MinifyReport

    Raises
    ------
    FexelError
        Missing or damaged stage, one without a texture that can have a filter, a wrong option, an output that cannot be
        written. Nothing is written then.

    Examples
    --------
    >>> minify("scene.usda", "scene_fip.usda", MinifyOptions(filter="fipmap"))  # doctest: +SKIP
    """
    source, output, step = Path(source), Path(output), progress or silent
    _check_options(options)
    stage = open_stage(source)
    check_overlay(source, output)
    if report is not None:
        check_report(report, [source, output])
    overlay = StageOverlay(stage, source, output, "_fexel_minify_")
    limits = [_limit(stage, source, path) for path in options.prims]
    seen = _seen(stage, options, step)
    authored: dict[Sdf.Path, MinifiedTexture] = {}
    for found in each_texture(stage, limits):
        path = overlay.editable_path(found.prim)
        if path not in authored:
            choice = _choice(found.prim, seen, options)
            authored[path] = _author(overlay.layer, path, found, options, choice, limits)
            step("textures", len(authored), len(authored))
    if not authored:
        where = f" at or below {', '.join(options.prims)}" if limits else ""
        raise FexelError(f"{source}: no texture{where}, expected a fexel texture or a UsdUVTexture")
    overlay.write()
    result = MinifyReport(str(source), str(output), tuple(authored.values()))
    if report is not None:
        write_report(result, report)
    return result


def _check_options(options: MinifyOptions) -> None:
    if options.filter is not None and options.filter not in (*PORTABLE_FILTERS, AUTO):
        raise FexelError(f"--filter: '{options.filter}', expected one of {', '.join((*PORTABLE_FILTERS, AUTO))}")
    if not (math.isfinite(options.bound_db) and options.bound_db > 0):
        raise FexelError(f"--bound: {options.bound_db:g}, expected a finite number of decibels above 0")
    if not 1 <= options.width <= _WIDEST:
        raise FexelError(f"--imageWidth: {options.width}, expected 1 to {_WIDEST} pixels")
    for name, value in (("--contrast", options.contrast), ("--brightness", options.brightness)):
        if value is not None and not math.isfinite(value):
            raise FexelError(f"{name}: {value:g}, expected a finite number")
    distance, color = options.attenuation_distance, options.attenuation_color
    if distance is not None and not distance > 0:  # NaN, too
        raise FexelError(f"--attenuationDistance: {distance:g}, expected more than 0 scene units (inf: none)")
    if color is not None and not all(math.isfinite(v) and v >= 0 for v in color):
        raise FexelError(f"--attenuationColor: {color}, expected finite values from 0")
    if not _values(options, is_data=False):
        raise FexelError("nothing to author, expected --filter or one of the other options")


def _limit(stage: Usd.Stage, source: Path, path: str) -> Sdf.Path:
    if not Sdf.Path.IsValidPathString(path) or not path.startswith("/") or not stage.GetPrimAtPath(path):
        raise FexelError(f"--prim {path}: no such prim in {source}")
    return Sdf.Path(path)


@dataclass(frozen=True, eq=False)
class _Seen:
    """How cameras see textures, and why some cannot be seen; by their paths outside of instances."""

    pictures: dict[Sdf.Path, list[SeenFootprints]] = field(default_factory=dict)
    unplaced: dict[Sdf.Path, str] = field(default_factory=dict)


def _seen(stage: Usd.Stage, options: MinifyOptions, step: Progress) -> _Seen:
    """What is seen, where a filter has to be chosen."""
    result = _Seen()
    if options.filter == AUTO:
        found = seen_footprints(stage, options.width, step)
        for path, pictures in found.footprints.items():
            result.pictures.setdefault(_shared_path(stage.GetPrimAtPath(path)), []).extend(pictures)
        for path, reason in found.unplaced.items():
            result.unplaced.setdefault(_shared_path(stage.GetPrimAtPath(path)), reason)
    return result


def _shared_path(prim: Usd.Prim) -> Sdf.Path:
    return (prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath()


def _choice(prim: Usd.Prim, seen: _Seen, options: MinifyOptions) -> FilterChoice | None:
    """What is chosen for a texture; None where the user has."""
    if options.filter != AUTO:
        return None
    path = _shared_path(prim)
    if pictures := seen.pictures.get(path):
        return choose_filter(prim, pictures, options.bound_db)
    return unjudged(seen.unplaced[path]) if path in seen.unplaced else UNSEEN


def _values(options: MinifyOptions, is_data: bool) -> dict[str, tuple[Sdf.ValueTypeName, Any]]:
    """Attributes to author, by name after the namespace; of data, the filter alone."""
    types, color = Sdf.ValueTypeNames, options.attenuation_color
    wanted = {
        "filter": (types.Token, options.filter),
        "contrast": (types.Float, options.contrast),
        "brightness": (types.Float, options.brightness),
        "attenuationDistance": (types.Float, options.attenuation_distance),
        "attenuationColor": (types.Color3f, None if color is None else Gf.Vec3f(*color)),
    }
    return {
        name: (type_name, value)
        for name, (type_name, value) in wanted.items()
        if value is not None and (name == "filter" or not is_data)
    }


def _author(
    layer: Sdf.Layer,
    path: Sdf.Path,
    found: FoundTexture,
    options: MinifyOptions,
    choice: FilterChoice | None,
    limits: Sequence[Sdf.Path],
) -> MinifiedTexture:
    """Apply the schema to one texture and author its attributes."""
    prim = found.prim
    options = replace(options, filter=choice.filter) if choice else options
    is_data = prim.GetPath() not in limits and holds_data(prim)
    values, all_values = _values(options, is_data), _values(options, is_data=False)
    if values:
        _author_api(layer, path, values)
    notes = [choice.reason] if choice else []
    notes += [_DATA_KEEP] if len(values) < len(all_values) else []
    notes += [_shared(prim)] if prim.IsInstanceProxy() else []
    note = "; ".join(filter(None, notes))
    predicted = choice.predicted_db if choice else {}
    return MinifiedTexture(str(prim.GetPath()), options.filter, found.variant, note, predicted)


def _author_api(layer: Sdf.Layer, path: Sdf.Path, values: dict[str, tuple[Sdf.ValueTypeName, Any]]) -> None:
    """Apply TextureMinificationAPI in a layer to the prim at a path, and author attributes of it."""
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[TextureMinificationAPI.schema]))
    for name, (type_name, value) in values.items():
        attribute = Sdf.AttributeSpec(spec, _NAMESPACE + name, type_name)
        attribute.default = value


def _shared(proxy: Usd.Prim) -> str:
    """What to know of a texture inside instances."""
    prototype = proxy.GetPrimInPrototype()
    while not prototype.IsPrototype():
        prototype = prototype.GetParent()
    count = len(prototype.GetInstances())
    return f"shared by {count} instances" if count > 1 else ""
