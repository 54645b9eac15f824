"""Images inside usdz packages are read like any other."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from pxr import UsdUtils

from fexel.errors import FexelError
from fexel.images import image_info, read_linear
from fexel.packages import is_packaged, local_file
from fexel.stage import open_stage
from fexel.validators import validate


@pytest.fixture
def package(sample, tmp_path):
    sample.stage.Save()
    path = tmp_path / "sample.usdz"
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "sample.usda"), str(path))
    return path


def test_packaged_image_equals_the_file_it_was_made_from(package, tmp_path):
    packaged = f"{package}[wall.png]"
    assert np.array_equal(read_linear(packaged), read_linear(str(tmp_path / "wall.png")))
    assert image_info(packaged).path == packaged


def test_package_is_unpacked_once(package):
    assert local_file(f"{package}[wall.png]") == local_file(f"{package}[wall.png]")


def test_ordinary_paths_are_left_alone():
    assert local_file("/a/b[1].png") == "/a/b[1].png"
    assert not is_packaged("/a/b[1].png")


@pytest.mark.parametrize("inner", ["gone.png", ""])
def test_missing_packaged_file_is_one_line(package, inner):
    with pytest.raises(FexelError, match="no such file") as error:
        image_info(f"{package}[{inner}]")
    assert "\n" not in str(error.value)


def test_missing_package_is_one_line(tmp_path):
    with pytest.raises(FexelError, match="no such file"):
        image_info(f"{tmp_path / 'gone.usdz'}[a.png]")


def test_packaged_stage_validates_and_a_damaged_image_in_it_is_found(package, tmp_path):
    assert validate(open_stage(package)) == []
    damaged = tmp_path / "damaged.usdz"
    with zipfile.ZipFile(package) as source, zipfile.ZipFile(damaged, "w", zipfile.ZIP_STORED) as target:
        for name in source.namelist():
            content = source.read(name)
            content = (
                content[: len(content) // 2] + bytes(len(content) - len(content) // 2) if "png" in name else content
            )
            entry = zipfile.ZipInfo(name)
            offset = target.fp.tell() + 30 + len(name)
            entry.extra = b"\x86\x19" + (-offset - 4 & 63).to_bytes(2, "little") + bytes(-offset - 4 & 63)
            target.writestr(entry, content)
    found = {finding.validator for finding in validate(open_stage(damaged))}
    assert "fexel:Files" in found
