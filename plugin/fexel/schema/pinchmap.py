"""Wrapper of PinchmapTexture."""

from __future__ import annotations

from typing import ClassVar

from fexel.schema.accessors import PinchmapTextureAccessors
from fexel.schema.texture import FexelTexture

__all__ = ["PinchmapTexture"]


class PinchmapTexture(PinchmapTextureAccessors, FexelTexture):
    """A small texture with sharp, curved discontinuities at any magnification."""

    schema: ClassVar[str] = "PinchmapTexture"
