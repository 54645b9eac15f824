"""From photos with a place to textures: colour, mask, file.

Per patch, parents first (section 4 of Eisemann and Magnor 2010, *Zipmaps*):

1. exposure and white balance: the photo's colours are matched to the composite below it;
2. Poisson equation with the composite's colours on a one-pixel ring and the photo's own gradient as guidance;
3. blend mask, eqs. (2) and (3), times a hand-made alpha if the photo has one;
4. a tiled, mip-mapped texture at the photo's own resolution: nothing is resampled, the projective map goes into the
prim.

Patches that do not overlap are made at the same time; a patch waits for those below it.

Conventions: linear Rec.709 float32 images, continuous pixel coordinates, 3x3 float64 for column vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from fexel.images import linear_to_srgb
from fexel_tools.blend_mask import blend_mask
from fexel_tools.color_match import match_color
from fexel_tools.composite import Composite, Layer
from fexel_tools.consistency import apply_homography
from fexel_tools.coverage import clip_convex, rectangle
from fexel_tools.photos import Photo, load_photo
from fexel_tools.poisson import clone, detailed_border, ring_points
from fexel_tools.texture_files import write_texture

__all__ = ["PatchJob", "write_textures"]

_MATCH_SIDE_PX = 384  # exposure and white balance are found on a reduced picture of this size
_MASK_PIXELS = 1_500_000  # a larger patch gets its mask from a reduced picture: the ramp is a sixteenth of its side
_MANY_PIXELS = 16_000_000  # two patches at a time only below this, for memory


@dataclass(frozen=True, eq=False)
class PatchJob:
    """A texture to be made.

    Attributes
    ----------
    photo : Photo
    window : (x0, y0, x1, y1)
        Its part, pixels of the photo.
    root_from_photo : (3, 3) float64
    file : Path
        Texture to write.
    bits : int or str
        8, 16 or "half", as `write_texture` has it.
    is_root : bool
        The root is written as it is.
    match_colors : bool
        Steps 1 and 2.
    blend : bool
        Step 3; False where an artist's mask replaces it.
    tau : float or None
        Of eq. (3); None is automatic.
    opacity : float
    mask : str
        Artist's mask that replaces alpha where other patches meet this one; '' for none.
    ready : bool
        The file is there already and stays as it is: it only lies below others.
    """

    photo: Photo
    window: tuple[int, int, int, int]
    root_from_photo: np.ndarray
    file: Path
    bits: int | str = 8
    is_root: bool = False
    match_colors: bool = True
    blend: bool = True
    tau: float | None = None
    opacity: float = 1.0
    mask: str = ""
    ready: bool = False

    @property
    def color_space(self) -> str:
        """``sRGB`` for integer textures, ``raw`` for float ones, which are linear."""
        return "sRGB" if self.bits in (8, 16) else "raw"

    @property
    def layer(self) -> Layer:
        """The written texture in the root's pixels."""
        x0, y0 = self.window[:2]
        texture_from_photo = np.array([[1.0, 0.0, -x0], [0.0, 1.0, -y0], [0.0, 0.0, 1.0]])
        texture_from_root = texture_from_photo @ np.linalg.inv(self.root_from_photo)
        return Layer(str(self.file), self.color_space, texture_from_root, self.opacity, self.mask)


def write_textures(jobs: list[PatchJob], threads: int, done: Callable[[PatchJob], None] | None = None) -> None:
    """Make all textures.

    Parameters
    ----------
    jobs : list of PatchJob
        The root first, then patches so that what lies below comes before what lies above.
    threads : int
    done : callable, optional
        Called with each finished job, from its thread.
    """
    largest = max((j.window[2] - j.window[0]) * (j.window[3] - j.window[1]) for j in jobs)
    threads = 1 if largest > _MANY_PIXELS else max(1, threads)
    outlines = [apply_homography(job.root_from_photo, rectangle(*job.window)) for job in jobs]
    futures: list[Future] = []
    with ThreadPoolExecutor(threads) as pool:
        for k, job in enumerate(jobs):
            below = [i for i in range(k) if len(clip_convex(outlines[k], outlines[i])) >= 3]
            waits, layers = [futures[i] for i in below], [jobs[i].layer for i in below]
            futures.append(pool.submit(_run, job, waits, layers, done))
        try:
            for future in futures:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _run(job: PatchJob, waits: list[Future], layers: list[Layer], done: Callable[[PatchJob], None] | None) -> None:
    for future in waits:  # submitted earlier, so started earlier: this cannot lock up
        future.result()
    if not job.ready:
        _write_root(job) if job.is_root else _write_patch(job, Composite(layers))
    if done:
        done(job)


def _write_root(job: PatchJob) -> None:
    """The root is opaque: below it there is nothing that an alpha could show."""
    rgb, _ = load_photo(job.photo)
    write_texture(job.file, rgb, bits=job.bits, color_space=job.color_space)


def _write_patch(job: PatchJob, below: Composite) -> None:
    rgb, hand_made = load_photo(job.photo)
    x0, y0, x1, y1 = job.window
    rgb = np.ascontiguousarray(rgb[y0:y1, x0:x1])
    hand_made = None if hand_made is None else hand_made[y0:y1, x0:x1]
    if job.match_colors:
        rgb = _match_exposure(job, below, rgb)
        rgb = _meet_below(job, below, rgb)
    alpha = hand_made
    if job.blend:
        alpha = _blend_alpha(rgb, job.tau)
        alpha = alpha if hand_made is None else alpha * hand_made
    write_texture(job.file, rgb, alpha, bits=job.bits, color_space=job.color_space)


def _match_exposure(job: PatchJob, below: Composite, rgb: np.ndarray) -> np.ndarray:
    height, width = rgb.shape[:2]
    step = max(1.0, max(height, width) / _MATCH_SIDE_PX)
    size = (max(1, round(width / step)), max(1, round(height / step)))
    columns = (np.arange(size[0]) + 0.5) * (width / size[0]) + job.window[0]
    rows = (np.arange(size[1]) + 0.5) * (height / size[1]) + job.window[1]
    points = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    parent = below.sample(job.root_from_photo, points, step).reshape(size[1], size[0], 3)
    return match_color(rgb, parent, np.diag([size[0] / width, size[1] / height, 1.0])).apply(rgb)


def _meet_below(job: PatchJob, below: Composite, rgb: np.ndarray) -> np.ndarray:
    points = ring_points(*rgb.shape[:2]) + np.array(job.window[:2], np.float64)
    border = below.sample(job.root_from_photo, points)
    solved = clone(rgb, detailed_border(rgb, border, below.texel_px(job.root_from_photo, points)))
    return np.maximum(solved, np.float32(0.0), out=solved)  # the equation has no bounds, light has


def _blend_alpha(rgb: np.ndarray, tau: float | None) -> np.ndarray:
    """(H, W) float32 blend mask, eqs. (2) and (3), of the sRGB-encoded patch.

    Of a large patch the picture is reduced first and alpha enlarged. A path's cost, summed differences of neighbours,
    hardly changes with that, except for noise that averages out; the transition is hundreds of pixels wide. A given tau
    counts the gradients of the photo's own pixels, noise included, so then nothing is reduced.
    """
    height, width = rgb.shape[:2]
    reduced = rgb
    if tau is None and height * width > _MASK_PIXELS:
        ratio = (_MASK_PIXELS / (height * width)) ** 0.5
        reduced = cv2.resize(rgb, (round(width * ratio), round(height * ratio)), interpolation=cv2.INTER_AREA)
    alpha = blend_mask(linear_to_srgb(np.clip(reduced, 0.0, 1.0)), tau=tau).alpha
    if reduced is not rgb:
        alpha = cv2.resize(alpha, (width, height), interpolation=cv2.INTER_LINEAR)
    return alpha
