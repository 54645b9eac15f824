"""Output appears whole or not at all, and never destroys what is not its own."""

from __future__ import annotations

import os

import pytest
from pxr import Sdf

from fexel.errors import FexelError
from fexel_tools.staged_output import check_output, staged_output


def write(out, text, texture="t.tif"):
    with staged_output(out) as staged:
        asset = f"./{staged.textures.name}/{texture}"
        staged.stage.write_text(f'#usda 1.0\n# {text}\ndef "T" {{ asset inputs:file = @{asset}@\n}}\n', "utf-8")
        (staged.textures / texture).write_text(text, "utf-8")


def write_and_fail(out, error):
    with staged_output(out) as staged:
        staged.stage.write_text("half", "utf-8")
        (staged.textures / "t.tif").write_text("half", "utf-8")
        raise error


def test_stage_and_textures_appear_together(tmp_path):
    write(tmp_path / "a.usda", "one")
    assert {p.name for p in tmp_path.iterdir()} == {"a.usda", "a_textures"}
    assert (tmp_path / "a_textures" / "t.tif").read_text() == "one"


def test_failure_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        write_and_fail(tmp_path / "a.usda", KeyboardInterrupt)
    assert list(tmp_path.iterdir()) == []


def test_failure_leaves_the_earlier_output(tmp_path):
    write(tmp_path / "a.usda", "one")
    with pytest.raises(MemoryError):
        write_and_fail(tmp_path / "a.usda", MemoryError)
    assert (tmp_path / "a_textures" / "t.tif").read_text() == "one"
    assert "one" in (tmp_path / "a.usda").read_text()


def test_second_run_replaces_the_first_and_its_textures(tmp_path):
    write(tmp_path / "a.usda", "one", "old.tif")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "a.usda"))
    write(tmp_path / "a.usda", "two", "new.tif")
    assert [p.name for p in (tmp_path / "a_textures").iterdir()] == ["new.tif"]
    assert {p.name for p in tmp_path.iterdir()} == {"a.usda", "a_textures"}
    assert "two" in (tmp_path / "a.usda").read_text()
    assert not layer.dirty


@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
@pytest.mark.parametrize("step", range(6))
def test_failure_while_moving_leaves_the_earlier_output_or_the_new_one(tmp_path, monkeypatch, earlier, error, step):
    """Renaming number step // 2 fails, or is done and interrupted: never orphans, never a mixture."""
    if earlier:
        write(tmp_path / "a.usda", "one")
    replace, calls = os.replace, []

    def fail(source, target):
        calls.append(target)
        if len(calls) - 1 == step // 2 and step % 2 == 0:
            raise error
        replace(source, target)
        if len(calls) - 1 == step // 2:
            raise error

    monkeypatch.setattr("os.replace", fail)
    renamings = 3 if earlier else 2
    if step // 2 < renamings:
        with pytest.raises(FexelError if isinstance(error, OSError) else KeyboardInterrupt):
            write(tmp_path / "a.usda", "two")
    else:
        write(tmp_path / "a.usda", "two")
    done = step // 2 >= renamings or step == 2 * renamings - 1
    expected = "two" if done else "one" if earlier else None
    assert {p.name for p in tmp_path.iterdir()} == ({"a.usda", "a_textures"} if expected else set())
    if expected:
        assert (tmp_path / "a_textures" / "t.tif").read_text() == expected
        assert expected in (tmp_path / "a.usda").read_text()


def test_missing_stage_file_counts_as_failure(tmp_path):
    write(tmp_path / "a.usda", "one")
    with pytest.raises(FexelError, match=r"a\.usda"), staged_output(tmp_path / "a.usda"):
        pass
    assert (tmp_path / "a_textures" / "t.tif").read_text() == "one"


def test_folder_of_the_users_own_is_not_touched(tmp_path):
    (tmp_path / "a_textures").mkdir()
    (tmp_path / "a_textures" / "holiday.tif").write_text("mine", "utf-8")
    with pytest.raises(FexelError, match="a_textures: is in the way"):
        write(tmp_path / "a.usda", "one")
    assert (tmp_path / "a_textures" / "holiday.tif").read_text() == "mine"


def test_folder_beside_a_stage_that_does_not_name_its_files_is_not_touched(tmp_path):
    write(tmp_path / "a.usda", "one")
    (tmp_path / "a_textures" / "holiday.tif").write_text("mine", "utf-8")
    for text in (None, "damaged"):
        if text:
            (tmp_path / "a.usda").write_text(text, "utf-8")
        with pytest.raises(FexelError, match="a_textures: is in the way"):
            write(tmp_path / "a.usda", "two")
        assert (tmp_path / "a_textures" / "holiday.tif").read_text() == "mine"


@pytest.mark.parametrize(("name", "message"), [("a_textures/t.tif", "which the output replaces"), ("a.usda", "input")])
def test_output_never_replaces_an_input(tmp_path, monkeypatch, name, message):
    write(tmp_path / "a.usda", "one")
    monkeypatch.chdir(tmp_path)
    check_output("a.usda", ["elsewhere.tif", "b_textures/t.tif"])
    with pytest.raises(FexelError, match=message):
        check_output("a.usda", [tmp_path / name])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.png", "'.png', expected one of .usda, .usdc, .usd"),
        ("a", "expected one of"),
        ("a.usdz", "usdzip"),
        ("gone/a.usda", "does not exist"),
        ("folder.usda", "is a folder"),
    ],
)
def test_bad_output_is_told_before_any_work(tmp_path, name, message):
    (tmp_path / "folder.usda").mkdir()
    with pytest.raises(FexelError, match=message):
        check_output(tmp_path / name)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder_is_told_before_any_work(tmp_path):
    tmp_path.chmod(0o555)
    with pytest.raises(FexelError, match="cannot be written to"):
        check_output(tmp_path / "a.usda")
    tmp_path.chmod(0o755)
