"""Where fexel's schemas and shaders lie: inside the package in a wheel, at the repository's root in a checkout."""

from __future__ import annotations

from pathlib import Path

from fexel.errors import FexelError

__all__ = ["schemas_dir", "shaders_dir"]

_PACKAGE = Path(__file__).resolve().parent
_REPOSITORY = _PACKAGE.parent.parent


def schemas_dir() -> Path:
    """Folder with ``plugInfo.json`` and ``generatedSchema.usda``, as ``PXR_PLUGINPATH_NAME`` expects it."""
    return _resource_dir("schemas", "plugInfo.json")


def shaders_dir() -> Path:
    """Folder with the GLSL sources."""
    return _resource_dir("shaders", "")


def _resource_dir(name: str, marker: str) -> Path:
    for root in (_PACKAGE, _REPOSITORY):
        if (root / name / marker).exists():
            return root / name
    raise FexelError(f"{_PACKAGE / name}: not found; the installation of fexel is incomplete, install it again")
