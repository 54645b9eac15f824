"""Make or find the chains of an image in a process of its own: ``python -m bench.chain_database FILE 1,2 [--read]``.

The numbers are those of directions. Prints one line of JSON: seconds of reading the image, of all chains of these
directions (reading included), processor seconds, peak of resident memory in MB (10^6 bytes) above that at the start,
and bytes of texels. Of each direction a window of 256x256 of every level is read, as a view does.
"""

from __future__ import annotations

import json
import sys
import time

from bench.first_frame import peak_resident_mb
from fexel.filters.chain import Chain
from fexel.filters.chain_layout import ChainLayout
from fexel.filters.chain_texels import ChainTexels
from fexel.filters.shears import DIRECTIONS
from fexel.textures.image_source import ImageSource
from fexel.textures.page_format import PAGE_FORMATS
from fexel.textures.pyramid_cache import PyramidCache

__all__ = ["main"]

_WINDOW = 256


def main(file: str, directions: list[int], read_first: bool) -> None:
    """Print the report; `read_first`: the image and its mip levels are made before, as a view that shows them does."""
    base = PyramidCache()
    reader, source = ChainTexels(base=base), ImageSource(file, wrap=("repeat", "repeat"))
    before = peak_resident_mb()
    start, processor = time.perf_counter(), time.process_time()
    if read_first:
        base.window(source, "", 0, (0, 0, 1, 1))
    read = time.perf_counter() - start
    texel_bytes = 0
    for number in directions:
        facts = base.facts(source, "")
        layout = ChainLayout.of(number, facts.size, facts.wrap)
        texel_bytes += layout.total * PAGE_FORMATS[facts.page_class].bytes_per_texel
        _look(reader, Chain(source, number, DIRECTIONS[number].octaves))
    report = {
        "read_s": read,
        "made_s": time.perf_counter() - start,
        "processor_s": time.process_time() - processor,
        "peak_mb": peak_resident_mb() - before,
        "texel_bytes": texel_bytes,
    }
    print(json.dumps(report))


def _look(reader: ChainTexels, chain: Chain) -> None:
    facts = reader.facts(chain, "")
    for level in range(facts.last_level + 1):
        width, height = (min(_WINDOW, max(1, size >> level)) for size in facts.size)
        reader.window(chain, "", level, (0, 0, width, height))


if __name__ == "__main__":
    main(sys.argv[1], [int(number) for number in sys.argv[2].split(",")], "--read" in sys.argv)
