"""Where the schemas and shaders are: in an installed wheel inside the package, in a checkout at the repository's root."""

from __future__ import annotations

from pathlib import Path

__all__ = ["schemas_dir", "shaders_dir"]

_PACKAGE = Path(__file__).resolve().parent


def schemas_dir() -> Path:
    """Folder with `generatedSchema.usda` and `plugInfo.json`."""
    return _folder("schemas")


def shaders_dir() -> Path:
    """Folder with the GLSL files."""
    return _folder("shaders")


def _folder(name: str) -> Path:
    installed = _PACKAGE / name
    return installed if installed.is_dir() else _PACKAGE.parent.parent / name
