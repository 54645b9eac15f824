"""UsdRender settings, products and vars of a stage as what to render.

A RenderSettings prim gives camera, resolution, aspect policy and pixel aspect ratio; its products may override each of
these; their vars are AOVs by ``sourceName``. Not used: data windows, materialBindingPurposes, namespaced settings.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fexel.errors import FexelError, FexelWarning
from fexel.renderer.aov import AOVS

if TYPE_CHECKING:
    from pxr import Usd, UsdRender

__all__ = ["RenderTarget", "render_targets"]


@dataclass(frozen=True)
class RenderTarget:
    """An image to make; None where the stage says nothing.

    `image` is the product's name, '' for the settings prim itself. `aovs` is empty when no var is given.
    """

    image: str = ""
    camera: str | None = None
    width: int | None = None
    height: int | None = None
    conform_policy: str = "expandAperture"
    pixel_aspect: float = 1.0
    aovs: tuple[str, ...] = ()


def render_targets(stage: Usd.Stage, prim_path: str | None) -> tuple[RenderTarget, ...]:
    """The settings prim's own target first, then its products'.

    Parameters
    ----------
    stage : Usd.Stage
    prim_path : str or None
        Path of a RenderSettings prim; None: the stage's metadata ``renderSettingsPrimPath``, if it has any.

    Returns
    -------
    tuple of RenderTarget
        The first has the AOVs of all products; one empty target when the stage has no settings.

    Raises
    ------
    FexelError
        `prim_path` is no RenderSettings prim; the message lists those there are.
    """
    from pxr import UsdRender

    prim_path = prim_path or stage.GetMetadata("renderSettingsPrimPath")
    if not prim_path:
        return (RenderTarget(),)
    settings = UsdRender.Settings(_prim(stage, prim_path))
    if not settings:
        found = " ".join(str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdRender.Settings)) or "none"
        raise FexelError(f"{prim_path}: not a RenderSettings prim; the stage has {found}")
    own = _with_base(RenderTarget(), settings, inherited=False)
    products = [
        _product(stage, UsdRender.Product(stage.GetPrimAtPath(path)), own)
        for path in settings.GetProductsRel().GetForwardedTargets()
    ]
    found = tuple(product for product in products if product is not None)
    aovs = tuple(dict.fromkeys(name for product in found for name in product.aovs))
    return (replace(own, aovs=aovs), *(product for product in found if product.image))


def _prim(stage: Usd.Stage, path: str) -> Usd.Prim:
    from pxr import Sdf

    if not Sdf.Path.IsValidPathString(str(path)) or not str(path).startswith("/"):
        raise FexelError(f"{path!r}: not the absolute path of a prim")
    return stage.GetPrimAtPath(str(path))


def _with_base(target: RenderTarget, prim: UsdRender.SettingsBase, *, inherited: bool) -> RenderTarget:
    """`target` with what the prim says; only what is authored, where it inherits from the settings prim."""
    changes = {}
    cameras = prim.GetCameraRel().GetForwardedTargets()
    if cameras:
        changes["camera"] = str(cameras[0])
    resolution = prim.GetResolutionAttr()
    if resolution.HasAuthoredValue():
        changes["width"], changes["height"] = (int(size) for size in resolution.Get())
    for name, attribute in (
        ("conform_policy", prim.GetAspectRatioConformPolicyAttr()),
        ("pixel_aspect", prim.GetPixelAspectRatioAttr()),
    ):
        if attribute.HasAuthoredValue() or not inherited:
            changes[name] = attribute.Get()
    return replace(target, **changes)


def _product(stage: Usd.Stage, product: UsdRender.Product, own: RenderTarget) -> RenderTarget | None:
    if not product:
        return None
    path = product.GetPath()
    if product.GetProductTypeAttr().Get() != "raster":
        warnings.warn(f"{path}: product type other than raster, left out", FexelWarning, stacklevel=2)
        return None
    target = _with_base(own, product, inherited=True)
    image = product.GetProductNameAttr().Get() or ""
    return replace(target, image=str(image), aovs=_aovs(stage, product))


def _aovs(stage: Usd.Stage, product: UsdRender.Product) -> tuple[str, ...]:
    from pxr import UsdRender

    names = []
    for path in product.GetOrderedVarsRel().GetForwardedTargets():
        name = UsdRender.Var(stage.GetPrimAtPath(path)).GetSourceNameAttr().Get() if stage.GetPrimAtPath(path) else ""
        if name in AOVS:
            names.append(name)
        else:
            message = f"{path}: no AOV {name!r}, left out; there are {' '.join(AOVS)}"
            warnings.warn(message, FexelWarning, stacklevel=2)
    return tuple(dict.fromkeys(names))
