"""Open a stage and render one frame, in a process of its own: ``python -m bench.first_frame STAGE CAMERA WIDTH``.

Prints one line of JSON: seconds of importing, of opening and rendering, and the largest resident memory in MB (10^6
bytes) before the stage is opened and at the end.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

__all__ = ["main"]


def main(stage_path: str, camera: str, width: int) -> None:
    start = time.perf_counter()
    from pxr import Usd

    import fexel

    render = fexel.render  # loads the renderer
    imported_mb, imported = peak_resident_mb(), time.perf_counter()
    stage = Usd.Stage.Open(stage_path)
    opened = time.perf_counter()
    image = render(stage, camera=camera, width=width)["color"]
    rendered = time.perf_counter()
    report = {
        "import_s": imported - start,
        "open_s": opened - imported,
        "render_s": rendered - opened,
        "imported_mb": imported_mb,
        "peak_mb": peak_resident_mb(),
        "mean": float(image[..., :3].mean()),
        "shape": list(image.shape),
    }
    print(json.dumps(report))


def peak_resident_mb() -> float:
    """Largest resident set so far, 10^6 bytes, libraries' mapped pages included.

    Linux: VmHWM, for ru_maxrss of a process is never below its parent's at the fork. macOS counts ru_maxrss in bytes.
    """
    status = Path("/proc/self/status")
    if status.is_file():
        lines = dict(line.split(":", 1) for line in status.read_text(encoding="ascii").splitlines())
        return int(lines["VmHWM"].split()[0]) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
