"""The table of fexel's validators, and their registration with `pxr.UsdValidation`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pxr import Usd, UsdValidation

from fexel._register import require_schemas
from fexel.validators.color_space import check_data_files, check_surface
from fexel.validators.fallback import check_fallback, check_fallback_types
from fexel.validators.fault import Fault
from fexel.validators.files import check_files
from fexel.validators.pinchmap import check_pinchmap
from fexel.validators.placement import check_depth, check_matrix, check_parent
from fexel.validators.umbrella import check_umbrella_arrays
from fexel.validators.values import check_limits

__all__ = ["KEYWORD", "register_validators"]

KEYWORD = "FexelValidators"

_TEXTURE = "FexelFexelTexture"
_UMBRELLA = ("FexelUmbrellaTexture", "FexelUmbrellaPatch", "FexelUmbrellaLevel")


@dataclass(frozen=True)
class _PrimValidator:
    """A check of the prims of some types: TfType names, as `UsdValidation` wants them."""

    name: str
    doc: str
    types: tuple[str, ...]
    check: Callable[[Usd.Prim], Iterable[Fault]]


_PRIM_VALIDATORS = (
    _PrimValidator(
        "fexel:Files",
        "Images that a texture names must exist and be readable to the last row.",
        (_TEXTURE, "FexelUmbrellaPatch", "FexelUmbrellaLevel"),
        check_files,
    ),
    _PrimValidator(
        "fexel:Matrix",
        "inputs:matrix must be finite and invertible, with w of one sign over the patch.",
        (_TEXTURE,),
        check_matrix,
    ),
    _PrimValidator(
        "fexel:PatchInsideParent", "A patch should lie inside the unit square of its parent.", (_TEXTURE,), check_parent
    ),
    _PrimValidator("fexel:NestingDepth", "Nests should be at most 32 levels deep.", (_TEXTURE,), check_depth),
    _PrimValidator(
        "fexel:ColorSpace",
        "Colours must be read as colours; normals, roughness, opacity and other data must be read raw.",
        ("UsdShadeShader",),
        check_surface,
    ),
    _PrimValidator(
        "fexel:DataColorSpace", "Masks and pinchmaps hold data and must be raw.", (_TEXTURE,), check_data_files
    ),
    _PrimValidator(
        "fexel:Fallback",
        "A texture that a material uses should hold a self-contained UsdUVTexture for other applications.",
        (_TEXTURE,),
        check_fallback,
    ),
    _PrimValidator(
        "fexel:Limits",
        "Values must lie within the limits and tokens of the schema.",
        (_TEXTURE, "FexelUmbrellaLevel"),
        check_limits,
    ),
    _PrimValidator(
        "fexel:Pinchmap",
        "A pinchmap must have four finite channels in [-1, 1] and go with the size of its signal.",
        ("FexelPinchmapTexture",),
        check_pinchmap,
    ),
    _PrimValidator(
        "fexel:UmbrellaArrays",
        "Arrays of umbrellas must have matching lengths and existing indices.",
        _UMBRELLA,
        check_umbrella_arrays,
    ),
)


def register_validators() -> None:
    """Register fexel's validators with `UsdValidation.ValidationRegistry`, once per process.

    Raises
    ------
    FexelError
        USD does not know fexel's schema, see `fexel._register`.
    """
    require_schemas()
    registry = UsdValidation.ValidationRegistry()
    for validator in _PRIM_VALIDATORS:
        if not registry.HasValidator(validator.name):
            registry.RegisterPrimValidator(_metadata(validator), _prim_task(validator))
    if not registry.HasValidator("fexel:FallbackTypes"):
        metadata = UsdValidation.ValidatorMetadata(
            "fexel:FallbackTypes",
            keywords=[KEYWORD],
            doc="The root layer should declare what fexel's prim types are to be taken for by other applications.",
        )
        registry.RegisterStageValidator(metadata, _stage_task)


def _metadata(validator: _PrimValidator) -> UsdValidation.ValidatorMetadata:
    return UsdValidation.ValidatorMetadata(
        validator.name, keywords=[KEYWORD], doc=validator.doc, schemaTypes=list(validator.types)
    )


def _prim_task(validator: _PrimValidator) -> Callable[..., list[UsdValidation.ValidationError]]:
    def task(prim: Usd.Prim, _times: UsdValidation.ValidationTimeRange) -> list[UsdValidation.ValidationError]:
        return [_usd_error(fault, prim.GetStage()) for fault in validator.check(prim)]

    return task


def _stage_task(stage: Usd.Stage, _times: UsdValidation.ValidationTimeRange) -> list[UsdValidation.ValidationError]:
    return [_usd_error(fault, stage) for fault in check_fallback_types(stage)]


def _usd_error(fault: Fault, stage: Usd.Stage) -> UsdValidation.ValidationError:
    severity = UsdValidation.ValidationErrorType.Error if fault.is_error else UsdValidation.ValidationErrorType.Warn
    site = UsdValidation.ValidationErrorSite(stage, fault.path)
    return UsdValidation.ValidationError("Fault", severity, [site], fault.message)
