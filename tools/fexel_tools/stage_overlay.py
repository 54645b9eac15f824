"""A thin layer over a stage: its opinions go where they can be edited, inside scenegraph instances too.

The stage is a sublayer of the layer and stays as it is. Prims inside instances cannot be edited where they appear:
every instance of a prototype inherits the same class of the layer, with the opinions in it, so that they stay
instances. Written whole or not at all.
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from pxr import Sdf, Tf, Usd

from fexel.errors import FexelError

__all__ = ["OUTPUT_FORMATS", "StageOverlay", "check_overlay", "relative_path", "write_layer"]

OUTPUT_FORMATS = (".usda", ".usdc", ".usd")
"""Extensions of layers that can be written."""

# Of the layer itself, and what all layers of a stage have a say in.
_NOT_COPIED = ("subLayers", "subLayerOffsets", "documentation", "comment", "owner", "sessionOwner", "layerRelocates")


def check_overlay(source: Path, output: Path) -> None:
    """See to it, before any work, that the layer can be written and replaces nothing that it is made from.

    Raises
    ------
    FexelError
        Wrong extension, missing or unwritable folder, a folder in the way, or the output is the input.
    """
    if output.suffix.lower() not in OUTPUT_FORMATS:
        raise FexelError(f"{output}: expected a name that ends in {', '.join(OUTPUT_FORMATS)}")
    if not output.parent.is_dir():
        raise FexelError(f"{output.parent}: no such folder")
    if output.is_dir():
        raise FexelError(f"{output}: is a folder, expected a file name")
    if not os.access(output.parent, os.W_OK | os.X_OK):
        raise FexelError(f"{output}: the folder {output.parent} cannot be written to")
    if output.exists() and output.samefile(source):
        raise FexelError(f"{output}: is the input as well; write to another file")


class StageOverlay:
    """A layer over a stage while it fills.

    Parameters
    ----------
    stage : Usd.Stage
        As opened from `source`. The layer is not put on it, so that its prototypes keep their names.
    source, output : Path
    classes : str
        How names of inherited classes begin, such as ``_fexel_st_``.

    Raises
    ------
    FexelError
        The output is one of the layers that the stage is made of.
    """

    def __init__(self, stage: Usd.Stage, source: Path, output: Path, classes: str) -> None:
        used = {os.path.realpath(layer.realPath) for layer in stage.GetUsedLayers() if layer.realPath}
        if os.path.realpath(output) in used:
            raise FexelError(f"{output}: is a layer of {source}; write to another file")
        self.layer = Sdf.Layer.CreateAnonymous(".usda")
        self.layer.subLayerPaths = [relative_path(source, output)]
        self._stage, self._output, self._classes = stage, output, classes
        _copy_stage_metadata(stage.GetRootLayer(), self.layer)

    def editable_path(self, prim: Usd.Prim) -> Sdf.Path:
        """Where opinions about a prim go: its own path, or inside the class that its prototype's instances inherit."""
        if prim.IsInstanceProxy():
            prim = prim.GetPrimInPrototype()
        if not prim.IsInPrototype():
            return prim.GetPath()
        prototype = prim
        while not prototype.IsPrototype():
            prototype = prototype.GetParent()
        return prim.GetPath().ReplacePrefix(prototype.GetPath(), self._class_of(prototype))

    def write(self) -> None:
        """Write the layer to the output, see `write_layer`."""
        write_layer(self.layer, self._output)

    def _class_of(self, prototype: Usd.Prim) -> Sdf.Path:
        """The class for a prototype; made, and inherited by all its instances, when first asked for."""
        instances = sorted(prototype.GetInstances(), key=lambda prim: str(prim.GetPath()))
        targets = [self.editable_path(instance) for instance in instances]
        for spec in (self.layer.GetPrimAtPath(path) for path in targets):
            inherited = spec.inheritPathList.prependedItems if spec else []
            made = [path for path in inherited if path.name.startswith(self._classes)]
            if made:
                return made[0]
        path = self._free_path(self._classes + Tf.MakeValidIdentifier(instances[0].GetName()))
        Sdf.CreatePrimInLayer(self.layer, path).specifier = Sdf.SpecifierClass
        for target in targets:
            Sdf.CreatePrimInLayer(self.layer, target).inheritPathList.Prepend(path)
        return path

    def _free_path(self, name: str) -> Sdf.Path:
        number, path = 0, Sdf.Path(f"/{name}")
        while self._stage.GetPrimAtPath(path) or self.layer.GetPrimAtPath(path):
            number += 1
            path = Sdf.Path(f"/{name}_{number}")
        return path


def relative_path(source: Path, output: Path) -> str:
    """Path of a file as the output names it, anchored with ./ so that USD looks beside the layer."""
    relative = Path(os.path.relpath(source.resolve(), output.parent.resolve())).as_posix()
    return relative if relative.startswith("../") else f"./{relative}"


def write_layer(layer: Sdf.Layer, output: Path) -> None:
    """Export beside the output, then rename over it.

    Raises
    ------
    FexelError
        USD cannot write it; the earlier output stays.
    """
    handle, temporary = tempfile.mkstemp(prefix=f".{output.stem}-", suffix=output.suffix, dir=output.parent)
    os.close(handle)
    try:
        if not layer.Export(temporary):
            raise FexelError(f"{output}: USD could not write it")
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, output)
    finally:
        Path(temporary).unlink(missing_ok=True)
    earlier = Sdf.Layer.Find(str(output))
    if earlier:  # an earlier version is open in this process
        earlier.Reload(True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _copy_stage_metadata(source: Sdf.Layer, target: Sdf.Layer) -> None:
    """Up axis, units, time codes, default prim...: USD reads them from the root layer alone."""
    for key in source.pseudoRoot.ListInfoKeys():
        if key not in _NOT_COPIED:
            target.pseudoRoot.SetInfo(key, source.pseudoRoot.GetInfo(key))
