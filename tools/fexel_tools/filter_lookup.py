"""Images looked up on the GPU at given places with given footprints, by any filter: for tests and measurements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from fexel.filters import DEFAULT_ACCESSES, DEFAULT_KERNEL
from fexel.filters.view import FilterView
from fexel.renderer.program import ProgramCache
from fexel.textures.image_source import ImageSource
from fexel.textures.image_view import image_defines, write_image_records
from fexel.textures.page_format import PAGE_FORMATS
from fexel.textures.pool import TexturePool

__all__ = ["Looked", "look_up"]


@dataclass(frozen=True, eq=False)
class Looked:
    """What lookups gave; arrays of length M.

    Attributes
    ----------
    color : (M, 4) float32
        Linear, premultiplied.
    lod, fetches : (M,) float32
    filter : (M,) float32
        Number in `fexel.filters.FILTERS`; -1 where the lookup does not say.
    stats : dict
        Of the pool.
    """

    color: NDArray[np.float32]
    lod: NDArray[np.float32]
    fetches: NDArray[np.float32]
    filter: NDArray[np.float32]
    stats: dict[str, int]


def look_up(
    gl,
    source: ImageSource,
    token: str,
    xy: NDArray[np.float64],
    jacobian: NDArray[np.float64],
    *,
    memory_mb: float = 512.0,
    anisotropy: float = 8.0,
    seen: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None,
    kernel: str = DEFAULT_KERNEL,
    accesses: int = DEFAULT_ACCESSES,
) -> Looked:
    """Look an image up, as shaders/image.glsl does.

    Parameters
    ----------
    gl : moderngl.Context
    source : ImageSource
    token : str
    xy : (M, 2) float64
        Texels of level 0, x right, y down, not wrapped.
    jacobian : (M, 2, 2) float64
        d(texel)/d(pixel), y down, column j per pixel along x, y; any values.
    memory_mb, anisotropy : float
    seen : Jacobians (K, P, 2, 2), low and high (K, 2), optional
        What is foreseen instead of the very lookups; see `FilterView.of`.
    kernel : str
        One of `fexel.filters.KERNELS`.
    accesses : int
        One of `fexel.filters.FIPMAP_ACCESSES`.
    """
    pool = TexturePool(gl, memory_mb, anisotropy, filter_kernel=kernel, fipmap_accesses=accesses)
    pool.begin()
    width, height = pool.facts(pool.image(source, "/Image")).size
    uv = np.stack([xy[:, 0] / width, 1 - xy[:, 1] / height], axis=1)
    reach = 0.5 * np.abs(jacobian).sum(axis=2) / [width, height]
    usable = np.isfinite(reach).all(axis=1) & (reach < 1e6).all(axis=1) & np.isfinite(uv).all(axis=1)
    low, high = (np.where(usable[:, None], bound, edge) for bound, edge in ((uv - reach, 0.0), (uv + reach, 1.0)))
    view = FilterView.of(pool, source, "/Image", token, *(seen or (jacobian, low, high)))
    view.ask(pool)
    pool.load()
    start, _ = write_image_records([view], pool)
    pool.records.upload()
    derivative = np.stack([jacobian[:, 0] / width, -jacobian[:, 1] / height], axis=1)
    defines = image_defines([view], pool, probes=anisotropy > 1) | {"TEXTURE_RECORDS": 1, "LOOKUP_COUNTS": 1}
    defines |= {f"PAGES_{page.name.upper()}": int(n in view.page_classes(pool)) for n, page in enumerate(PAGE_FORMATS)}
    color, lookup = _drawn(gl, pool, defines, start, uv, np.swapaxes(derivative, 1, 2).reshape(-1, 4))
    stats = pool.stats()
    pool.release()
    return Looked(color, lookup[:, 0], lookup[:, 1], lookup[:, 2], stats)


def _drawn(gl, pool: TexturePool, defines: dict, record: int, *given: NDArray) -> list[NDArray[np.float32]]:
    """Both targets of image_lookup.frag, (M, 4) each."""
    count = len(given[0])
    side = int(np.ceil(np.sqrt(count)))
    textures = {}
    for name, values in zip(("lookupSt", "lookupJacobian"), given, strict=True):
        texels = np.zeros((side * side, 4), np.float32)
        texels[:count, : values.shape[1]] = values
        textures[name] = gl.texture((side, side), 4, texels.tobytes(), dtype="f4")
    program = ProgramCache(gl).get("fullscreen.vert", "image_lookup.frag", defines)
    used = textures | {"textureRecords": pool.records.texture}
    used |= {f"pages{page.name}": atlas.texture for page, atlas in zip(PAGE_FORMATS, pool.atlases, strict=True)}
    for unit, (name, texture) in enumerate(used.items()):
        if name in program and texture is not None:
            texture.use(unit)
            program[name] = unit
    half = np.array([(0.5 / atlas.size[0], 0.5 / atlas.size[1], 0, 0) for atlas in pool.atlases], np.float32)
    if "pageHalfTexel" in program:
        uniform = cast("Any", program["pageHalfTexel"])
        uniform.write(half[: uniform.array_length].tobytes())
    for name, value in (("imageRecord", record), ("imageMaxProbes", pool.anisotropy)):
        if name in program:
            program[name] = value
    targets = [gl.texture((side, side), 4, dtype="f4") for _ in range(2)]
    framebuffer = gl.framebuffer(targets)
    framebuffer.use()
    gl.vertex_array(program, []).render(gl.TRIANGLES, vertices=3)
    results = [np.frombuffer(target.read(), np.float32).reshape(-1, 4)[:count].copy() for target in targets]
    gl.detect_framebuffer(0).use()  # moderngl would bind the released one again
    for item in (framebuffer, *targets, *textures.values()):
        item.release()
    return results
