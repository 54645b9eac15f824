"""The table of `fexel.filters.losses` as a file of the package: computing it takes seconds, whatever the image is.

``python -m fexel.filters.loss_table`` writes it anew, after a change of a filter or of `fexel.filters.transfer`. A byte
per loss: 0, or quarter octaves above a loss that does not matter; what is off by a tenth at most averages out over the
frequencies of an image. Compressed by LZMA.
"""

from __future__ import annotations

import lzma
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fexel.errors import FexelError

__all__ = ["FILE", "LEAST", "packed", "read"]

FILE = Path(__file__).with_name("losses.xz")

LEAST = 1e-4
"""Share of a wave's energy; of what loses less nothing counts as lost."""

_STEPS = 4  # an octave


def read(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Losses of that shape.

    Raises
    ------
    FexelError
        The file is missing, damaged, or holds another number of losses.
    """
    try:
        codes = np.frombuffer(lzma.decompress(FILE.read_bytes()), np.uint8)
    except (OSError, lzma.LZMAError) as error:
        raise FexelError(f"{FILE}: {error}, expected the table of losses") from None
    if codes.size != np.prod(shape):
        raise FexelError(f"{FILE}: {codes.size} losses, expected {np.prod(shape)}")
    known = LEAST * np.exp2((np.arange(256) - 1) / _STEPS)
    known[0] = 0.0
    return known.astype(np.float32)[codes].reshape(shape)


def packed(losses: NDArray[np.floating]) -> bytes:
    """What the file holds of losses."""
    codes = np.rint(_STEPS * np.log2(np.maximum(losses, LEAST) / LEAST)) + 1
    codes = np.where(losses > LEAST, codes, 0).astype(np.uint8)
    return lzma.compress(codes.tobytes(), preset=9 | lzma.PRESET_EXTREME)


def _write() -> None:
    from fexel.filters import losses

    every = [losses.computed(candidate, losses.footprints()) for candidate in losses.STORED]
    FILE.write_bytes(packed(np.array(every)))


if __name__ == "__main__":
    _write()
