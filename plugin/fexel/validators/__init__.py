"""fexel's validators, registered with `pxr.UsdValidation`, and one call that runs these and all of USD's.

A module per topic, and one per kind of texture that has something of its own to check (``pinchmap``, ``umbrella``);
each declares its ``VALIDATORS`` (`prim_validator`), of which `registration.prim_validators` makes the list. A new kind
adds its module and touches nothing here. ``fexel:FallbackTypes`` alone looks at a stage as a whole.

All carry the keyword ``FexelValidators``.
"""

from __future__ import annotations

from fexel.validators.registration import register_validators
from fexel.validators.report import Finding, validate, validate_file

__all__ = ["Finding", "register_validators", "validate", "validate_file"]
