"""`import fexel`: what it loads, and what happens when it comes too late. Each test needs a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

HEAVY = ["numpy", "OpenImageIO", "moderngl", "cv2", "scipy", "numba", "pxr.Usd", "fexel_tools"]
TOO_LATE = "import fexel before opening any stage"
PLAIN_USD = """
from pxr import Usd
stage = Usd.Stage.CreateInMemory()
print(stage.DefinePrim('/a', 'ZipmapTexture').GetPropertyNames())
"""


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    env = {name: value for name, value in os.environ.items() if name != "PXR_PLUGINPATH_NAME"} | environment
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)


def test_import_loads_nothing_heavy():
    result = run(f"import fexel, sys; print([name for name in {HEAVY} if name in sys.modules])")
    assert result.stdout.strip() == "[]"
    assert result.stderr == ""


def test_import_does_not_freeze_the_schema_registry():
    code = "import fexel; from pxr import Plug; print(Plug.Registry().GetPluginWithName('sdf').isLoaded)"
    assert run(code).stdout.strip() == "False"


def test_first_stage_after_import_knows_the_types():
    code = (
        "import fexel; from pxr import Usd; s = Usd.Stage.CreateInMemory(); print(fexel.ZipmapTexture.Define(s, '/a'))"
    )
    assert run(code).stdout.strip() == "fexel.ZipmapTexture(Usd.Prim(</a>))"


@pytest.mark.parametrize(
    "first",
    [
        "Usd.Stage.CreateInMemory().DefinePrim('/a', 'Mesh')",
        "Usd.SchemaRegistry().FindConcretePrimDefinition('Mesh')",
        "s = Usd.Stage.CreateInMemory(); s.DefinePrim('/a', 'ZipmapTexture')",
    ],
)
def test_import_after_the_registry_was_built_warns_and_says_what_to_do(first):
    result = run(f"from pxr import Usd\n{first}\nimport fexel")
    assert "FexelWarning" in result.stderr
    assert TOO_LATE in result.stderr
    assert "PXR_PLUGINPATH_NAME" in result.stderr
    assert result.returncode == 0


@pytest.mark.parametrize(
    "use",
    [
        "fexel.ZipmapTexture()",
        "fexel.ZipmapTexture.Define(stage, '/b')",
        "fexel.ZipmapTexture.Get(stage, '/a')",
        "fexel.TextureMinificationAPI.CanApply(stage.GetPrimAtPath('/a'))",
        "fexel.validate(stage)",
        "from fexel.stage import open_stage; open_stage('whatever.usda')",
    ],
)
def test_use_after_late_import_raises_one_line(use):
    code = f"""
import warnings; warnings.simplefilter("ignore")
from pxr import Usd
stage = Usd.Stage.CreateInMemory(); stage.DefinePrim("/a", "Mesh")
import fexel
try:
    {use}
except fexel.FexelError as error:
    print(error)
"""
    result = run(code)
    assert TOO_LATE in result.stdout, result.stderr
    assert result.stdout.count("\n") == 1


def test_import_after_an_untyped_layer_is_in_time():
    code = "from pxr import Sdf; layer = Sdf.Layer.CreateAnonymous(); import fexel; print(bool(fexel.ZipmapTexture))"
    result = run(code)
    assert result.stderr == ""
    assert result.stdout.strip() == "True"


def test_plugin_path_makes_a_late_import_harmless():
    from fexel._resources import schemas_dir

    code = (
        "from pxr import Usd; s = Usd.Stage.CreateInMemory(); s.DefinePrim('/a', 'Mesh'); import fexel; print('fine')"
    )
    result = run(code, PXR_PLUGINPATH_NAME=str(schemas_dir()))
    assert (result.stdout.strip(), result.stderr) == ("fine", "")


def test_plugin_path_alone_teaches_plain_usd_the_types():
    from fexel._resources import schemas_dir

    assert "inputs:mask" in run(PLAIN_USD, PXR_PLUGINPATH_NAME=str(schemas_dir())).stdout


def test_without_the_plugin_plain_usd_does_not_know_the_types():
    assert run(PLAIN_USD).stdout.strip() == "[]"


def test_unknown_attribute_of_the_package_is_an_attribute_error():
    import fexel

    with pytest.raises(AttributeError, match="no attribute 'Zipmap'"):
        fexel.Zipmap  # noqa: B018


def test_every_public_name_can_be_had():
    import fexel

    for name in fexel.__all__:
        assert getattr(fexel, name) is not None
    assert set(fexel.__all__) <= set(dir(fexel))
