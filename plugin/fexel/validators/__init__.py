"""fexel's validators, registered with `pxr.UsdValidation`, and one call that runs these and all of USD's.

=========================  =========================================================================================
name                       finds
=========================  =========================================================================================
fexel:Files                missing, unreadable or truncated images
fexel:Matrix               matrices that are not finite or singular, or whose w changes sign inside the patch
fexel:PatchInsideParent    patches that lie wholly or partly outside their parent
fexel:NestingDepth         nests deeper than 32 levels
fexel:ColorSpace           colours read as data, data (normals, roughness, opacity) read as colours
fexel:DataColorSpace       masks and pinchmaps that carry a colour space
fexel:Fallback             outputs without a self-contained UsdUVTexture for applications that do not know fexel
fexel:FallbackTypes        a stage that does not say what its fexel prims are to be taken for elsewhere
fexel:Limits               values outside the range or the tokens that the schema allows
fexel:Pinchmap             pinchmaps without four finite channels in [-1, 1], or of a size unlike their signal's
fexel:UmbrellaArrays       arrays of umbrellas whose lengths or indices disagree
=========================  =========================================================================================

All carry the keyword ``FexelValidators``.
"""

from __future__ import annotations

from fexel.validators.registration import register_validators
from fexel.validators.report import Finding, validate, validate_file

__all__ = ["Finding", "register_validators", "validate", "validate_file"]
