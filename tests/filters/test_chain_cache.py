"""Chains on disk: found by content, made anew where they are damaged, harmless where nothing can be written."""

import os
import shutil
import subprocess
import sys
import warnings
import zipfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdUtils

from fexel.errors import FexelWarning
from fexel.filters import chain_cache, chain_key, chain_texels
from fexel.filters.chain import Chain
from fexel.filters.chain_texels import ChainTexels
from fexel.filters.shears import DIRECTIONS
from fexel.textures.image_source import ImageSource
from fexel.textures.pyramid_cache import PyramidCache

NUMBER = 4


@pytest.fixture(autouse=True)
def _on_disk(monkeypatch, tmp_path):
    monkeypatch.delenv("FEXEL_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "user"))
    monkeypatch.setattr(chain_texels, "_LEAST_BYTES", 0)


@pytest.fixture
def picture(tmp_path, rng):
    (tmp_path / "assets").mkdir()
    return write(tmp_path / "assets" / "noise.png", rng.integers(0, 255, (40, 60, 3), np.uint8))


def write(path, pixels):
    assert oiio.ImageBuf(np.ascontiguousarray(pixels)).write(str(path))
    return str(path)


def source_of(file, **settings):
    return ImageSource(file, **{"wrap": ("repeat", "repeat"), **settings})


def all_texels(source, number=NUMBER, reader=None):
    """Every level of the longest chain."""
    reader, chain = reader or ChainTexels(), Chain(source, number, DIRECTIONS[number].octaves)
    facts = reader.facts(chain, "/Texture")
    sizes = [tuple(max(1, size >> level) for size in facts.size) for level in range(facts.last_level + 1)]
    return [reader.window(chain, "/Texture", level, (0, 0, *size)) for level, size in enumerate(sizes)]


def beside(file):
    return sorted((Path(file.split("[")[0]).parent / ".fexel-cache").glob("*.chains"))


def same(one, two):
    return all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


class _HeadersOnly(PyramidCache):
    def window(self, *_):
        raise AssertionError("texels of the image are read")


def test_what_was_made_is_found_without_reading_the_image_again(picture):
    made = all_texels(source_of(picture))
    assert len(beside(picture)) == 1
    assert same(all_texels(source_of(picture), reader=ChainTexels(base=_HeadersOnly())), made)
    assert (beside(picture)[0].parent / ".gitignore").read_text() == "*\n"


def test_a_folder_that_has_moved_keeps_its_chains(picture, tmp_path):
    made = all_texels(source_of(picture))
    shutil.move(tmp_path / "assets", tmp_path / "elsewhere")
    moved = str(tmp_path / "elsewhere" / "noise.png")
    os.utime(moved)
    assert same(all_texels(source_of(moved), reader=ChainTexels(base=_HeadersOnly())), made)


def test_another_content_or_anything_else_done_to_it_has_a_file_of_its_own(picture, tmp_path, rng):
    mask = write(tmp_path / "mask.png", rng.integers(0, 255, (10, 10, 1), np.uint8))
    kinds = [
        {},
        {"wrap": ("mirror", "repeat")},
        {"wrap": ("clamp", "clamp")},
        {"color_space": "raw"},
        {"scale": (0.5, 1.0, 1.0, 1.0)},
        {"bias": (0.1, 0.0, 0.0, 0.0)},
        {"mask": mask},
    ]
    for count, kind in enumerate(kinds, start=1):
        fresh = all_texels(source_of(picture, **kind))
        assert len(beside(picture)) == count
        assert same(all_texels(source_of(picture, **kind), reader=ChainTexels(base=_HeadersOnly())), fresh)
    all_texels(source_of(picture), number=5)
    assert len(beside(picture)) == len(kinds) + 1
    before = all_texels(source_of(picture))
    write(picture, rng.integers(0, 255, (40, 60, 3), np.uint8))
    assert not same(all_texels(source_of(picture)), before)
    assert len(beside(picture)) == len(kinds) + 2


def test_file_that_is_rewritten_in_place_with_its_size_and_time_has_chains_of_its_own(tmp_path, rng):
    file = str(tmp_path / "noise.tif")  # without compression: as large whatever is in it
    write(file, rng.integers(0, 255, (40, 60, 3), np.uint8))
    before, status = all_texels(source_of(file)), os.stat(file)
    write(file, rng.integers(0, 255, (40, 60, 3), np.uint8))
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert (os.stat(file).st_size, os.stat(file).st_mtime_ns) == (status.st_size, status.st_mtime_ns)
    after = all_texels(source_of(file))
    assert not same(after, before)
    file = shutil.copy(file, str(tmp_path / "elsewhere.tif"))
    assert same(all_texels(source_of(file), reader=ChainTexels(base=_HeadersOnly())), after)


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(path.read_bytes()[:-1]),
        lambda path: path.write_bytes(path.read_bytes()[:100]),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(bytes(path.stat().st_size)),
        lambda path: path.write_bytes(b"X" + path.read_bytes()[1:]),
        lambda path: path.write_bytes(path.read_bytes()[:60] + b"\xff" + path.read_bytes()[61:]),
        lambda path: path.write_bytes(path.read_bytes()[:5000] + b"\x01\x80" + path.read_bytes()[5002:]),
        lambda path: path.write_bytes(
            path.read_bytes()[:-9] + bytes([path.read_bytes()[-9] ^ 4]) + path.read_bytes()[-8:]
        ),
        lambda path: (path.unlink(), path.mkdir()),
    ],
    ids=["cut", "cut short", "empty", "zeros", "magic", "sums", "first cell", "last cell", "a folder"],
)
def test_damage_is_repaired_without_a_word(picture, damage):
    made = all_texels(source_of(picture))
    whole = beside(picture)[0].read_bytes()
    damage(beside(picture)[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert same(all_texels(source_of(picture)), made)
    if beside(picture)[0].is_file():
        assert beside(picture)[0].read_bytes() == whole
    assert not list(beside(picture)[0].parent.glob("*.part"))


def test_another_version_is_made_anew(picture, monkeypatch):
    made = all_texels(source_of(picture))
    monkeypatch.setattr(chain_key, "FORMAT_VERSION", chain_key.FORMAT_VERSION + 1)
    assert same(all_texels(source_of(picture)), made)
    assert len(beside(picture)) == 2


def test_a_folder_that_cannot_be_written_to_gives_way_to_the_users(picture, tmp_path):
    (Path(picture).parent / ".fexel-cache").write_text("a file is in the way")
    made = all_texels(source_of(picture))
    assert len(list((tmp_path / "user" / "fexel").glob("*.chains"))) == 1
    assert same(all_texels(source_of(picture), reader=ChainTexels(base=_HeadersOnly())), made)
    shutil.rmtree(tmp_path / "user")
    (tmp_path / "user").write_text("and here")
    assert same(all_texels(source_of(picture)), made)  # in memory


@pytest.mark.parametrize("value", ["0", "", "off"])
def test_the_cache_can_be_switched_off(picture, tmp_path, monkeypatch, value):
    monkeypatch.setenv("FEXEL_CACHE", value)
    all_texels(source_of(picture))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["assets", "noise.png"]


def test_the_cache_can_lie_in_a_folder_of_choice(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("FEXEL_CACHE", str(tmp_path / "mine" / "chains"))
    made = all_texels(source_of(picture))
    assert len(list((tmp_path / "mine" / "chains").glob("*.chains"))) == 1
    assert not beside(picture)
    assert same(all_texels(source_of(picture), reader=ChainTexels(base=_HeadersOnly())), made)


def test_a_full_disk_leaves_nothing_behind(picture, tmp_path, monkeypatch):
    made = all_texels(source_of(picture))
    shutil.rmtree(beside(picture)[0].parent)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(chain_cache, "_reserve", full)
    assert same(all_texels(source_of(picture)), made)
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".chains", ".part")]


def test_a_failure_while_chains_are_made_leaves_nothing_behind(picture, tmp_path, monkeypatch):
    def fail(*_):
        raise RuntimeError("interrupted")

    monkeypatch.setattr(chain_texels, "build_chains", fail)
    with pytest.raises(RuntimeError, match="interrupted"):
        all_texels(source_of(picture))
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".chains", ".part")]


def test_a_folder_stays_within_its_size(picture, monkeypatch):
    for number in range(4):
        all_texels(source_of(picture), number=number)
    for age, path in enumerate(beside(picture)):
        os.utime(path, (1e9 - age, 1e9 - age))
    oldest = beside(picture)[1:]
    room = sum(path.stat().st_size for path in beside(picture))
    monkeypatch.setattr(chain_cache, "_MOST_BYTES", room - oldest[0].stat().st_size + 100)
    left = Path(beside(picture)[0].parent / ".aa.1.bb.part")
    left.write_bytes(b"left behind")
    os.utime(left, (1e9, 1e9))
    all_texels(source_of(picture), number=5)
    assert sum(path.stat().st_size for path in beside(picture)) <= chain_cache._MOST_BYTES
    assert beside(picture)
    assert not left.exists()
    assert not oldest[-1].exists()  # used longest ago


def test_chains_of_a_picture_within_a_package_lie_beside_the_package(picture, tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "assets" / "wall.usda"))
    prim = UsdGeom.Scope.Define(stage, "/Wall").GetPrim()
    prim.CreateAttribute("inputs:file", Sdf.ValueTypeNames.Asset).Set(Sdf.AssetPath("noise.png"))
    stage.SetDefaultPrim(prim)
    stage.Save()
    package = tmp_path / "package" / "wall.usdz"
    package.parent.mkdir()
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "assets" / "wall.usda"), str(package))
    inner = next(name for name in zipfile.ZipFile(package).namelist() if name.endswith(".png"))
    packaged = f"{package}[{inner}]"
    made = all_texels(source_of(packaged))
    assert [path.name for path in package.parent.iterdir()] != [package.name]
    assert len(beside(packaged)) == 1
    assert same(all_texels(source_of(packaged), reader=ChainTexels(base=_HeadersOnly())), made)
    assert same(all_texels(source_of(picture)), made)


def test_files_that_cannot_be_read_are_not_kept(picture, tmp_path):
    damaged = tmp_path / "assets" / "damaged.png"
    damaged.write_bytes(Path(picture).read_bytes()[:-2000])
    source = source_of(str(damaged), fallback=(1.0, 0.0, 0.0, 1.0))
    for _ in range(2):  # each renderer says so
        with pytest.warns(FexelWarning, match=r"damaged\.png"):
            texels = all_texels(source)
        assert (texels[0] == [255, 0, 0, 255]).all()
    assert not beside(picture)
    missing = source_of(str(tmp_path / "assets" / "missing.png"))
    with pytest.warns(FexelWarning, match=r"missing\.png"):
        all_texels(missing)
    assert not beside(picture)


def test_processes_do_not_hurt_each_other(picture, tmp_path):
    code = (
        "import sys, numpy as np\n"
        "sys.path[:0] = [sys.argv[1]]\n"
        "import test_chain_cache as t\n"
        "from fexel.filters import chain_texels\n"
        "chain_texels._LEAST_BYTES = 0\n"
        "for number in range(16):\n"
        "    texels = t.all_texels(t.source_of(sys.argv[2]), number=number)\n"
        "    print(hash(b''.join(each.tobytes() for each in texels)))\n"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), picture]
    environment = {**os.environ, "PYTHONHASHSEED": "1"}
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=120) for process in processes]
    assert all(process.returncode == 0 for process in processes), outputs
    assert len({out for out, _ in outputs}) == 1
    assert len(beside(picture)) == 16
    assert not list(beside(picture)[0].parent.glob(".*.part"))
    made = all_texels(source_of(picture), reader=ChainTexels(base=_HeadersOnly()))
    assert len(made) > 3
