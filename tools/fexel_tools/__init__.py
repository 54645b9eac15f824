"""Authoring tools of fexel and its command line; heavier dependencies than the plugin's."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fexel_tools.registration import Registration, register_pair

__all__ = ["Registration", "register_pair"]


def __getattr__(name: str) -> Any:
    """Import registration, and with it OpenCV, when it is first asked for."""
    if name in __all__:
        from fexel_tools import registration

        return getattr(registration, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
