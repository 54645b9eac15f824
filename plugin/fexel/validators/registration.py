"""fexel's validators, collected from the modules of this package, and their registration with `pxr.UsdValidation`."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable

from pxr import Usd, UsdValidation

import fexel.validators
from fexel._register import require_schemas
from fexel.schema.definition import base_types
from fexel.validators.fallback import check_fallback_types
from fexel.validators.fault import Fault
from fexel.validators.prim_validator import PrimValidator

__all__ = ["KEYWORD", "prim_validators", "register_validators"]

KEYWORD = "FexelValidators"


def prim_validators() -> list[PrimValidator]:
    """What the modules of `fexel.validators` declare as ``VALIDATORS``, a module after the other, by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(fexel.validators.__path__))
    modules = [importlib.import_module(f"fexel.validators.{name}") for name in names]
    return [validator for module in modules for validator in getattr(module, "VALIDATORS", ())]


def register_validators() -> None:
    """Register fexel's validators with `UsdValidation.ValidationRegistry`, once per process.

    Raises
    ------
    FexelError
        USD does not know fexel's schema, see `fexel._register`.
    """
    require_schemas()
    registry = UsdValidation.ValidationRegistry()
    for validator in prim_validators():
        if not registry.HasValidator(validator.name):
            registry.RegisterPrimValidator(_metadata(validator), _prim_task(validator))
    if not registry.HasValidator("fexel:FallbackTypes"):
        metadata = UsdValidation.ValidatorMetadata(
            "fexel:FallbackTypes",
            keywords=[KEYWORD],
            doc="The root layer should declare what fexel's prim types are to be taken for by other applications.",
        )
        registry.RegisterStageValidator(metadata, _stage_task)


def _metadata(validator: PrimValidator) -> UsdValidation.ValidatorMetadata:
    return UsdValidation.ValidatorMetadata(
        validator.name, keywords=[KEYWORD], doc=validator.doc, schemaTypes=list(validator.types or base_types())
    )


def _prim_task(validator: PrimValidator) -> Callable[..., list[UsdValidation.ValidationError]]:
    def task(prim: Usd.Prim, _times: UsdValidation.ValidationTimeRange) -> list[UsdValidation.ValidationError]:
        return [_usd_error(fault, prim.GetStage()) for fault in validator.check(prim)]

    return task


def _stage_task(stage: Usd.Stage, _times: UsdValidation.ValidationTimeRange) -> list[UsdValidation.ValidationError]:
    return [_usd_error(fault, stage) for fault in check_fallback_types(stage)]


def _usd_error(fault: Fault, stage: Usd.Stage) -> UsdValidation.ValidationError:
    severity = UsdValidation.ValidationErrorType.Error if fault.is_error else UsdValidation.ValidationErrorType.Warn
    site = UsdValidation.ValidationErrorSite(stage, fault.path)
    return UsdValidation.ValidationError("Fault", severity, [site], fault.message)
