"""The data texture of a view: records of all textures of all kinds, one after the other.

RGBA32F, `ROW` texels a row; shaders/texture_data.glsl fetches from it by one running number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import moderngl

__all__ = ["ROW", "RecordTexture"]

ROW = 1024
_LEAST_ROWS = 16


class RecordTexture:
    """Records that are appended for a view, then uploaded together."""

    def __init__(self, gl: moderngl.Context) -> None:
        self._gl = gl
        self.texture: moderngl.Texture | None = None
        self._parts: list[NDArray[np.float32]] = []
        self._count = 0

    @property
    def nbytes(self) -> int:
        """Of the texture."""
        return self.texture.width * self.texture.height * 16 if self.texture else 0

    @property
    def next(self) -> int:
        """Number that the next texel will have."""
        return self._count

    def begin(self) -> None:
        """Forget the records of the view before."""
        self._parts, self._count = [], 0

    def append(self, texels: NDArray[np.floating]) -> int:
        """Add texels (N, 4); returns the number of the first."""
        self._parts.append(texels.astype(np.float32))
        self._count += len(texels)
        return self._count - len(texels)

    def upload(self) -> None:
        """Send what was appended to the GPU."""
        rows = max(-(-self._count // ROW), 1)
        if self.texture is None or self.texture.height < rows:
            self.release()
            self.texture = self._gl.texture((ROW, max(rows, _LEAST_ROWS)), 4, dtype="f4")
            self.texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
        padded = np.zeros((rows * ROW, 4), np.float32)
        if self._parts:
            padded[: self._count] = np.concatenate(self._parts)
        self.texture.write(padded.tobytes(), viewport=(0, 0, ROW, rows))

    def release(self) -> None:
        """Free the texture."""
        if self.texture:
            self.texture.release()
            self.texture = None
