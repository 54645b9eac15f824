"""Registration of fexel's codeless schema with USD.

USD reads the schemas of all registered plugins once, when its schema registry is built: in practice with the first
stage of the process. A plugin that comes later is registered, yet its prim types stay unknown and no error is given.
So `register` runs on ``import fexel`` and warns when it came too late, and everything that needs the types calls
`require_schemas`, which raises.
"""

from __future__ import annotations

import warnings

from pxr import Plug

from fexel._resources import schemas_dir
from fexel.errors import FexelError, FexelWarning

__all__ = ["register", "require_schemas"]

_TOO_LATE = (
    "ZipmapTexture: not a prim type that USD knows, because fexel was imported after USD had built its schema registry "
    "(with the first prim type that it looks up); import fexel before opening any stage, or start the application with "
    "PXR_PLUGINPATH_NAME set to the folder that `fexel plugin-path` prints"
)
_schemas_are_known = False


def register() -> None:
    """Register the schema plugin; warn with `FexelWarning` when USD's schema registry was built without it.

    Costs no more than importing ``pxr.Plug``, and does not build the schema registry itself, so that further schema
    plugins can be registered afterwards.
    """
    registry = Plug.Registry()
    registry.RegisterPlugins(str(schemas_dir()))
    # Building the schema registry reads layers, which loads the plugin `sdf`; while that is not loaded, none was built.
    layers = registry.GetPluginWithName("sdf")
    if layers is not None and layers.isLoaded and not _find_schemas():
        warnings.warn(_TOO_LATE, FexelWarning, stacklevel=3)


def require_schemas() -> None:
    """Make sure that USD knows fexel's prim types.

    Raises
    ------
    FexelError
        fexel was imported after USD's schema registry had been built; the message says what to do.
    """
    if not _find_schemas():
        raise FexelError(_TOO_LATE)


def _find_schemas() -> bool:
    """Ask USD's schema registry (and build it if need be); a positive answer is final and remembered."""
    global _schemas_are_known
    if not _schemas_are_known:
        from pxr import Usd

        _schemas_are_known = Usd.SchemaRegistry().FindConcretePrimDefinition("ZipmapTexture") is not None
    return _schemas_are_known
