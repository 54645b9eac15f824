"""UsdGeomPointInstancer: where each prototype is placed.

Lengths are checked before USD computes the transforms (which then heed velocities and angular velocities between
samples); invisible and inactive ids, and entries whose prototype index fits no prototype, are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom

from fexel.scene.sampling import Faults, Sampler

__all__ = ["Placements", "place_instances"]


@dataclass(frozen=True, eq=False)
class Placements:
    """Instances of each prototype.

    Attributes
    ----------
    matrices : tuple of (N_p, 4, 4) float64
        Prototype root to instancer, per prototype; the root's own transform is not in it.
    colors : tuple of (N_p, 3) float64 or None
        ``primvars:displayColor`` of the instances, where the instancer has one per instance.
    """

    matrices: tuple[np.ndarray, ...]
    colors: tuple[np.ndarray | None, ...]


def place_instances(prim: Usd.Prim, prototype_count: int, sampler: Sampler, faults: Faults) -> Placements:
    """Read a PointInstancer; without any instance where its arrays do not fit each other (with a warning)."""
    instancer = UsdGeom.PointInstancer(prim)
    prototypes = sampler.array(instancer.GetProtoIndicesAttr(), np.int64)
    count = 0 if prototypes is None else len(prototypes)
    if not count or not _lengths_fit(instancer, count, sampler, faults):
        return Placements((np.zeros((0, 4, 4)),) * prototype_count, (None,) * prototype_count)
    for attribute in (
        instancer.GetVelocitiesAttr(),
        instancer.GetAccelerationsAttr(),
        instancer.GetAngularVelocitiesAttr(),
    ):
        sampler.get(attribute)  # the transforms below depend on them
    matrices = np.array(
        instancer.ComputeInstanceTransformsAtTime(
            sampler.time,
            sampler.time,
            UsdGeom.PointInstancer.ExcludeProtoXform,
            UsdGeom.PointInstancer.IgnoreMask,
        )
    ).reshape(-1, 4, 4)
    if len(matrices) != count:
        faults.warn(prim.GetPath(), f"USD computes {len(matrices)} transforms, expected {count}; instances skipped")
        return Placements((np.zeros((0, 4, 4)),) * prototype_count, (None,) * prototype_count)
    drawn = _shown(instancer, count, sampler) & _in_range(prim, prototypes, prototype_count, faults)
    drawn &= _finite(prim, matrices, faults)
    colors = _instance_colors(prim, count, sampler)
    chosen = [np.flatnonzero(drawn & (prototypes == p)) for p in range(prototype_count)]
    return Placements(
        tuple(matrices[rows] for rows in chosen), tuple(None if colors is None else colors[rows] for rows in chosen)
    )


def _lengths_fit(instancer: UsdGeom.PointInstancer, count: int, sampler: Sampler, faults: Faults) -> bool:
    """Whether positions, orientations and scales have one entry per instance; the last two may be absent."""
    fits = True
    for attribute, required in (
        (instancer.GetPositionsAttr(), True),
        (instancer.GetOrientationsAttr(), False),
        (instancer.GetOrientationsfAttr(), False),
        (instancer.GetScalesAttr(), False),
    ):
        value = sampler.get(attribute)
        found = 0 if value is None else len(value)
        if found != count and (required or found):
            expected = f"{found} entries, expected {count}, the number of protoIndices"
            faults.warn(attribute.GetPath(), f"{expected}; instances skipped")
            fits = False
    return fits


def _shown(instancer: UsdGeom.PointInstancer, count: int, sampler: Sampler) -> np.ndarray:
    """(count,) bool: neither invisible nor inactive."""
    sampler.get(instancer.GetIdsAttr())
    sampler.get(instancer.GetInvisibleIdsAttr())
    mask = np.array(instancer.ComputeMaskAtTime(sampler.time), bool)
    return mask if len(mask) == count else np.ones(count, bool)


def _in_range(prim: Usd.Prim, prototypes: np.ndarray, prototype_count: int, faults: Faults) -> np.ndarray:
    valid = (prototypes >= 0) & (prototypes < prototype_count)
    if not valid.all():
        found = f"{int((~valid).sum())} entries such as {int(prototypes[~valid][0])}"
        faults.warn(f"{prim.GetPath()}.protoIndices", f"{found}, expected 0 to {prototype_count - 1}; left out")
    return valid


def _finite(prim: Usd.Prim, matrices: np.ndarray, faults: Faults) -> np.ndarray:
    finite = np.isfinite(matrices).all(axis=(1, 2))
    if not finite.all():
        faults.warn(prim.GetPath(), f"{int((~finite).sum())} instances with NaN or infinity in their place; left out")
    return finite


def _instance_colors(prim: Usd.Prim, count: int, sampler: Sampler) -> np.ndarray | None:
    """(count, 3) display colours, or None where the instancer has not one per instance."""
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
    if not primvar or primvar.GetInterpolation() not in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
        return None
    colors = sampler.array(primvar.GetAttr(), np.float64, 3)
    indices = sampler.array(primvar.GetIndicesAttr(), np.int64) if primvar.IsIndexed() else None
    if colors is not None and indices is not None:
        valid = len(indices) and indices.min() >= 0 and indices.max() < len(colors)
        colors = colors[indices] if valid else None
    return colors if colors is not None and len(colors) == count and np.isfinite(colors).all() else None
