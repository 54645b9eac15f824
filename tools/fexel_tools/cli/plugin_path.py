"""``fexel plugin-path``."""

from __future__ import annotations

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("plugin-path")(_plugin_path)


def _plugin_path() -> None:
    """Print the folder that PXR_PLUGINPATH_NAME has to hold, so that any USD application knows fexel's prim types."""
    from fexel._resources import schemas_dir

    typer.echo(str(schemas_dir()))
