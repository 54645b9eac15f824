"""Small stages for scene extraction."""

from __future__ import annotations

import warnings

import pytest
from pxr import Sdf, Usd, UsdGeom

from fexel.errors import FexelWarning
from fexel.scene import SceneReader


@pytest.fixture
def stage():
    return Usd.Stage.CreateInMemory()


@pytest.fixture
def define_mesh():
    """Defines a mesh; one unit square of four corners unless told otherwise."""

    def define(stage, path, points=None, counts=(4,), indices=(0, 1, 2, 3), scheme="none", **primvars):
        mesh = UsdGeom.Mesh.Define(stage, path)
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)] if points is None else points)
        mesh.CreateFaceVertexCountsAttr(list(counts))
        mesh.CreateFaceVertexIndicesAttr(list(indices))
        mesh.CreateSubdivisionSchemeAttr(scheme)
        for name, (type_name, interpolation, value) in primvars.items():
            primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
                name, getattr(Sdf.ValueTypeNames, type_name), interpolation
            )
            primvar.Set(value)
        return mesh

    return define


@pytest.fixture
def read():
    """The scene of a stage, with the FexelWarnings it gave."""

    def read(stage, time=None, camera=None, aspect=1.0, **options):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            scene = SceneReader(stage, **options).at(time, camera, aspect)
        return scene, [str(w.message) for w in caught if issubclass(w.category, FexelWarning)]

    return read
