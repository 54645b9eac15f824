"""The page of a contact sheet: every picture whole in its place, labels beside and never over them."""

from __future__ import annotations

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel_tools.contact_sheet import SheetRow, contact_sheet, write_png


def flat(value, shape=(20, 30, 3)):
    return np.full(shape, value, np.uint8)


def test_every_picture_appears_whole_and_unchanged(rng):
    rows = [SheetRow("above", list(rng.integers(0, 256, (3, 20, 30, 3), np.uint8))) for _ in range(2)]
    page = contact_sheet(rows, ["1x", "2x", "3x"], gap=4)
    windows = np.lib.stride_tricks.sliding_window_view(page, (20, 30, 3))[:, :, 0]
    places = []
    for row in rows:
        for picture in row.pictures:
            found = np.argwhere((windows == picture).all((2, 3, 4)))
            assert len(found) == 1
            places.append(tuple(found[0]))
    tops, lefts = zip(*places, strict=True)
    assert lefts == (4, 38, 72, 4, 38, 72)
    assert len(set(tops[:3])) == len(set(tops[3:])) == 1 and tops[3] >= tops[0] + 20


def test_labels_are_drawn_outside_the_pictures():
    bare = contact_sheet([SheetRow(" ", [flat(0)] * 2)], ["", ""])
    labelled = contact_sheet([SheetRow("row", [flat(0)] * 2)], ["left", "right"])
    changed = np.argwhere((bare != labelled).any(-1))
    assert len(changed) > 50
    pictures = (bare == 0).all(-1)
    assert not pictures[changed[:, 0], changed[:, 1]].any()


@pytest.mark.parametrize(
    ("rows", "labels"),
    [
        ([], []),
        ([SheetRow("a", [flat(1), flat(1, (21, 30, 3))])], []),
        ([SheetRow("a", [flat(1)]), SheetRow("b", [flat(1)] * 2)], []),
        ([SheetRow("a", [flat(1)] * 2)], ["one"]),
    ],
)
def test_pictures_or_labels_that_do_not_match_are_refused(rows, labels):
    with pytest.raises(FexelError, match=r"^contact sheet: [^\n]*expected[^\n]*$"):
        contact_sheet(rows, labels)


def test_sheet_is_written_whole_or_not_at_all(tmp_path):
    write_png(tmp_path / "new" / "sheet.png", flat(7))
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["sheet.png"]
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FexelError, match="cannot be"):
        write_png(tmp_path / "file" / "sheet.png", flat(7))
    (tmp_path / "taken.png").mkdir()
    with pytest.raises(FexelError, match="cannot be"):
        write_png(tmp_path / "taken.png", flat(7))
    assert not list(tmp_path.glob(".*"))
