"""``fexel validate``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("validate")(_validate)


def _validate(
    stage: Annotated[Path, typer.Argument(help="USD stage: .usd, .usda, .usdc or .usdz.", show_default=False)],
) -> None:
    """Check a stage with USD's validators and fexel's own.

    Prints one line per finding, severity: prim: message (validator), errors first. Exit status 1 when there are errors
    or the stage cannot be opened, else 0.
    """
    from fexel.validators import validate_file

    findings = validate_file(stage)
    for finding in findings:
        typer.echo(str(finding))
    errors = sum(finding.severity == "error" for finding in findings)
    if sys.stderr.isatty():
        typer.echo(f"{errors} errors, {len(findings) - errors} others", err=True)
    if errors:
        raise typer.Exit(1)
