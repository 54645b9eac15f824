"""Opening a stage, with one-line errors."""

from __future__ import annotations

import os
from pathlib import Path

from pxr import Sdf, Tf, Usd, UsdUtils

from fexel._register import require_schemas
from fexel.errors import FexelError

__all__ = ["open_stage"]


def open_stage(path: str | os.PathLike[str], session_layer: str | os.PathLike[str] | None = None) -> Usd.Stage:
    """Open a stage from a file.

    Parameters
    ----------
    path : path-like
        A file of any format that USD reads.
    session_layer : path-like, optional
        Layer that is stronger than the file, never saved with it.

    Raises
    ------
    FexelError
        Missing file, or one that USD cannot read; USD does not know fexel's schema.
    """
    require_schemas()
    root = _open_layer(path)
    session = _open_layer(session_layer) if session_layer is not None else None
    try:
        return Usd.Stage.Open(root, session) if session else Usd.Stage.Open(root)
    except Tf.ErrorException as error:
        raise FexelError(f"{path}: {_one_line(error, path)}") from None


def _open_layer(path: str | os.PathLike[str]) -> Sdf.Layer:
    if Path(path).is_dir():
        raise FexelError(f"{path}: a folder, expected a USD file")
    if not Path(path).exists():
        raise FexelError(f"{path}: no such file")
    if not Sdf.Layer.IsAnonymousLayerIdentifier(str(path)) and Sdf.FileFormat.FindByExtension(str(path)) is None:
        raise FexelError(f"{path}: not a USD file, expected .usd, .usda, .usdc or .usdz")
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # the error says it in one line
    try:
        layer = Sdf.Layer.FindOrOpen(os.fspath(path))
    except Tf.ErrorException as error:
        raise FexelError(f"{path}: {_one_line(error, path)}") from None
    finally:
        diagnostics.TakeUncoalescedDiagnostics()
    if layer is None:
        raise FexelError(f"{path}: not a USD file, or a damaged one")
    return layer


def _one_line(error: Tf.ErrorException, path: str | os.PathLike[str]) -> str:
    """What USD says, without the place in its own sources."""
    reasons = [" ".join(part.commentary.split()) for part in error.args if hasattr(part, "commentary")]
    return ("; ".join(reasons) or " ".join(str(error).split())).removeprefix(f"{path}:").strip()
