"""Run every registered validator, USD's and fexel's, over a stage."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal

from pxr import Usd, UsdUtils, UsdValidation, Work

from fexel.stage import open_stage
from fexel.validators.registration import register_validators

__all__ = ["Finding", "validate", "validate_file"]

_Severity = Literal["error", "warning", "info"]

_SEVERITIES: dict[str, _Severity] = {"Error": "error", "Warn": "warning", "Info": "info"}


@dataclass(frozen=True, order=True)
class Finding:
    """One thing that a validator says of a stage.

    Attributes
    ----------
    severity : str
        ``error``, ``warning`` or ``info``.
    path : str
        Path of the prim; identifier of the layer, for what concerns a layer as a whole.
    message : str
        One line: the property if it is about one, what was found, what was expected.
    validator : str
        Name of the validator, such as ``fexel:Matrix`` or ``usdShadeValidators:ShaderSdrCompliance``.
    """

    severity: _Severity
    path: str
    message: str
    validator: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.path}: {self.message} ({self.validator})"


def validate(stage: Usd.Stage) -> list[Finding]:
    """Run all registered validators over the active, defined prims of a stage, instances included.

    Parameters
    ----------
    stage : Usd.Stage

    Returns
    -------
    list of Finding
        Errors first, then by path; each finding once.

    Raises
    ------
    FexelError
        USD does not know fexel's schema, see `fexel._register`.
    """
    register_validators()
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()  # what USD would print beside its findings
    with _one_thread():
        errors = UsdValidation.ValidationContext(validators).Validate(stage)
    diagnostics.TakeUncoalescedDiagnostics()
    return sorted({finding for error in errors if (finding := _finding(error))})


@contextmanager
def _one_thread() -> Iterator[None]:
    """Keep USD's threads from contending for Python's lock: 10,000 patches in 4.2 s instead of 9."""
    limit = Work.GetConcurrencyLimit()
    Work.SetConcurrencyLimit(1)
    try:
        yield
    finally:
        Work.SetConcurrencyLimit(limit)


def validate_file(path: str | os.PathLike[str]) -> list[Finding]:
    """Open a stage and `validate` it; what USD would print while it opens is among the findings.

    Raises
    ------
    FexelError
        The stage cannot be opened.
    """
    diagnostics = UsdUtils.CoalescingDiagnosticDelegate()
    stage = open_stage(path)
    diagnostics.TakeUncoalescedDiagnostics()
    return validate(stage)


def _finding(error: UsdValidation.ValidationError) -> Finding | None:
    severity = _SEVERITIES.get(error.GetType().name)
    if severity is None or error.HasNoError():
        return None
    sites = error.GetSites()
    path, prefix = _place(sites[0]) if sites else ("/", "")
    validator = error.GetValidator()
    name = str(validator.GetMetadata().name) if validator else "USD"
    return Finding(severity, path, prefix + " ".join(error.GetMessage().split()), name)


def _place(site: UsdValidation.ValidationErrorSite) -> tuple[str, str]:
    """Path of the prim or layer, and the property's name as a prefix of the message."""
    if site.IsPrim():
        return str(site.GetPrim().GetPath()), ""
    if site.IsProperty():
        attribute = site.GetProperty()
        return str(attribute.GetPrim().GetPath()), f"{attribute.GetName()}: "
    layer = site.GetLayer()
    return (layer.identifier if layer else "/"), ""
