"""Storage: the paper's equations, both sides compressed, and the report that says so."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from fexel_tools.report import write_report
from fexel_tools.umbrella_code import COLOR_STEP, decode_arrangement, encode_arrangement
from fexel_tools.umbrella_report import BaseReport, DroppedReport, UmbrellaReport, describe, describe_dropped
from fexel_tools.umbrella_storage import (
    CompressedSizes,
    ExplicitWords,
    bounding_boxes,
    compressed_sizes,
    explicit_resolution,
    explicit_words,
    jpeg_bytes,
    umbrella_words,
)
from tests.authoring import ground

FIRST_KEYS = ["b", "v", "k", "n", "grid", "J_words", "T_words", "compressed_ratio", "bytes", "level_bytes", "seconds"]


def upright(count=1, size=(2.0, 1.0), grid=(4, 4)):
    """Umbrellas of one square base that are `size` cells wide and high."""
    made = ground.arrangement(count, grid)
    square = np.array([[0, 0], [-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    shape = replace(made.shapes[0], points=square, morph_points=square, tex_coords=square + 0.5)
    matrices = np.zeros((count, 3, 3))
    matrices[:, 0, 0], matrices[:, 1, 1], matrices[:, 2] = size[0] / grid[0], size[1] / grid[1], (0.5, 0.5, 1.0)
    return replace(
        made,
        shapes=(shape,),
        shape_of=np.zeros(count, np.int32),
        matrices=matrices,
        colors=np.zeros((0, 3), np.float32),
    )


def test_words_follow_equation_2():
    """b w h + 2 b v + n (1 + 3 v) + k W H, of bases that are alike."""
    assert umbrella_words(upright(10), [(256, 128)], k=7) == 256 * 128 + 2 * 5 + 10 * (1 + 3 * 5) + 7 * 16


def test_fall_leaves_of_table_1_take_as_many_words_as_it_says():
    """b 9, v 63, k 19, n 6100, 256 x 256, 64 x 24: 1.78 million words; with unlike bases each counts with its own."""
    made = upright(6100)
    leaves = replace(
        made, shapes=tuple(replace(made.shapes[0], points=np.zeros((63, 2))) for _ in range(9)), grid=(64, 24)
    )
    words = umbrella_words(leaves, [(256, 256)] * 9, k=19)
    assert words == 9 * 256 * 256 + 2 * 9 * 63 + 6100 * (1 + 3 * 63) + 19 * 64 * 24 == 1_779_142
    mixed = ground.arrangement(50)
    vertices = mixed.vertex_counts
    bases = 10 * 20 + 30 * 40 + 5 * 6 + 2 * sum(len(s.points) for s in mixed.shapes)
    assert umbrella_words(mixed, [(10, 20), (30, 40), (5, 6)], k=3) == bases + 50 + 3 * vertices.sum() + 3 * 32


def test_explicit_texture_follows_equation_3():
    """One umbrella: w/x h/y W H in every reading. Of two sizes: the extremes and the mean of each factor."""
    one = explicit_words(upright(1, (2.0, 1.0)), [(256, 128)])
    assert (one.least, one.average, one.most) == pytest.approx((128 * 128 * 16,) * 3)
    two = upright(2, (2.0, 1.0))
    two.matrices[1, 0, 0] *= 2  # twice as wide
    words = explicit_words(two, [(256, 128)])
    assert words.least == pytest.approx(64 * 128 * 16)
    assert words.average == pytest.approx(96 * 128 * 16)
    assert words.most == pytest.approx(128 * 128 * 16)
    assert explicit_resolution(two, [(256, 128)]) == (96 * 4, 128 * 4)


def test_bounding_box_holds_the_morphed_and_turned_umbrella():
    made = ground.arrangement(20)
    sides = bounding_boxes(made)
    for number in range(20):
        own = made.vertices[made.first_vertex[number] : made.first_vertex[number + 1]] * made.grid
        assert np.allclose(sides[number], np.ptp(own, axis=0))


def test_odd_arrangements_have_no_infinite_size():
    empty = ground.arrangement(0)
    assert explicit_words(empty, [(8, 8)] * 3) == ExplicitWords(0.0, 0.0, 0.0)
    assert umbrella_words(empty, [(8, 8)] * 3, k=0) == 3 * 64 + 2 * sum(len(s.points) for s in empty.shapes)
    flat = ground.arrangement(5)
    flat.matrices[0] = 0.0  # singular: at infinity
    flat.matrices[1, :2, :2] = 0.0  # a point
    with np.errstate(all="ignore"):
        words = explicit_words(flat, [(8, 8)] * 3)
    assert np.isfinite([words.least, words.average, words.most]).all()
    untextured = explicit_words(ground.arrangement(5), [(0, 0)] * 3)
    assert untextured.average == 0.0


@pytest.mark.parametrize("count", [0, 1, 300])
def test_code_keeps_the_picture(count):
    """Every number comes back within the step that the module names: a fraction of a texel, of a colour in 8 bits."""
    made = ground.arrangement(count)
    code = encode_arrangement(made)
    back = decode_arrangement(code, made)
    assert np.array_equal(back.shape_of, made.shape_of)
    assert np.abs(back.morphs - made.morphs).max(initial=0) <= 0.5 / 255 + 1e-9
    assert np.abs(back.colors - made.colors).max(initial=0) <= 0.5 * COLOR_STEP + 1e-6
    period = np.round(back.matrices[:, 2, :2] - made.matrices[:, 2, :2])
    assert np.abs(back.matrices[:, 2, :2] - made.matrices[:, 2, :2] - period).max(initial=0) <= 0.5 / 65536 + 1e-9
    unmorphed = [replace(a, morphs=np.zeros(count), matrices=a.matrices - period_of(a)) for a in (made, back)]
    assert np.abs(unmorphed[0].vertices - unmorphed[1].vertices).max(initial=0) < 1e-4


def period_of(arrangement):
    shift = np.zeros_like(arrangement.matrices)
    shift[:, 2, :2] = np.floor(arrangement.matrices[:, 2, :2] + 1e-6)
    return shift


def test_code_holds_matrices_that_are_no_similarities():
    made = ground.arrangement(20)
    made.matrices[3, 0, 0] *= 1.5
    made.matrices[4, :, 2] = (0.05, 0.02, 1.0)
    back = decode_arrangement(encode_arrangement(made), made)
    assert np.allclose(back.matrices, made.matrices, rtol=1e-6, atol=1e-7)


def test_code_takes_matrices_as_homogeneous():
    """A multiple of a matrix is the same place; perspective alone, over a similarity, is no similarity."""
    made = ground.arrangement(20)
    scaled = replace(made, matrices=made.matrices * np.linspace(0.5, -2.0, 20)[:, None, None])
    assert encode_arrangement(scaled).streams == encode_arrangement(made).streams
    leaning = made.matrices.copy()
    leaning[7, 0, 2] = 0.05
    back = decode_arrangement(encode_arrangement(replace(made, matrices=leaning)), made)
    assert np.allclose(back.matrices, leaning, rtol=1e-6, atol=1e-7)


def test_shared_colours_are_stored_once():
    """As authoring gives umbrellas of a base some sets of colours."""
    made = ground.arrangement(2000)
    shared = made.colors.copy()
    for number, shape in enumerate(made.shapes):
        users = np.flatnonzero(made.shape_of == number)
        rows = made.first_vertex[users][:, None] + np.arange(len(shape.points))
        shared[rows] = shared[rows[np.arange(len(users)) % 8]]
    few = encode_arrangement(replace(made, colors=shared))
    assert np.abs(decode_arrangement(few, made).colors - shared).max() <= 0.5 * COLOR_STEP + 1e-6
    assert len(few.streams[-1]) < 0.1 * len(encode_arrangement(made).streams[-1])


def test_jpeg_bytes_are_those_of_a_jpeg_and_of_its_alpha(rng):
    picture = cv2.GaussianBlur(rng.random((64, 64, 4)).astype(np.float32), (0, 0), 3)
    opaque, holed = picture.copy(), picture.copy()
    opaque[..., 3] = 1.0
    holed[..., 3] = np.arange(64)[None] / 64
    assert jpeg_bytes(opaque) == jpeg_bytes(opaque[..., :3]) < jpeg_bytes(holed)
    assert jpeg_bytes(opaque, 90) > jpeg_bytes(opaque, 50) > 100
    assert jpeg_bytes(opaque, is_data=True) != jpeg_bytes(opaque)


def test_compressed_sides_of_a_texture_without_variety():
    """An explicit texture of one colour is no more than a JPEG's blocks; bytes grow with its texels."""
    made = replace(ground.arrangement(30), colors=np.zeros((0, 3), np.float32), shadow_strength=0.0)
    plain = tuple(np.full((64, 64, 4), 0.25, np.float32) for _ in range(3))
    for texture in plain:
        texture[..., 3] = 1.0
    sizes = compressed_sizes(made, plain, (0.25, 0.25, 0.25, 1.0))
    width, height = explicit_resolution(made, [(64, 64)] * 3)
    assert 0.01 < sizes.explicit / (width * height) < 0.05
    assert sizes.textures == sum(map(jpeg_bytes, plain))
    assert sizes.ratio == sizes.explicit / (sizes.textures + sizes.contours + sizes.arrangement)


def test_vectors_turn_in_the_explicit_texture():
    """A normal map that leans along x everywhere is one colour unless it turns with its umbrellas."""
    made = replace(ground.arrangement(60), colors=np.zeros((0, 3), np.float32), shadow_strength=0.0)
    leaning = tuple(np.full((16, 16, 4), (0.9, 0.5, 0.8, 1.0), np.float32) for _ in range(3))
    plain, turned = (
        compressed_sizes(made, leaning, (0.9, 0.5, 0.8, 1.0), is_data=True, vector_scale=scale).explicit
        for scale in (None, (2.0, 2.0))
    )
    assert turned > 1.2 * plain


def test_explicit_texture_is_drawn_in_windows_of_its_own_resolution():
    windows = []

    def draw(size, window):
        windows.append((size, window))
        return np.ones((size[1], size[0], 4), np.float32)

    made = upright(4, (0.125, 0.125), (8, 4))  # 256 texels in an eighth of a cell: 16384 x 8192
    compressed_sizes(made, [np.ones((256, 256, 4), np.float32)], None, draw=draw)
    assert explicit_resolution(made, [(256, 256)]) == (16384, 8192)
    assert len(windows) == 4
    for size, (s0, t0, s1, t1) in windows:
        assert size == (768, 768)
        assert (s1 - s0) * 16384 == pytest.approx(768) and (t1 - t0) * 8192 == pytest.approx(768)
        assert 0 <= s0 < s1 <= 1 and 0 <= t0 < t1 <= 1


def report(**changes):
    bases = (BaseReport("leaf", "leaf.png", 63, (256, 200), 0.01, 0.9, 1.0),)
    given = UmbrellaReport(
        stage="ground.usda",
        bases=bases,
        k=19,
        k_seen=12,
        n=6100,
        grid=(64, 24),
        words=1_000_000,
        explicit=ExplicitWords(10e6, 25e6, 50e6),
        resolution=(10000, 2500),
        texture_bytes=5,
        array_bytes=6,
        level_bytes=7,
        seconds=1.5,
        compressed=CompressedSizes(10, 20, 30, 300),
        dropped=(DroppedReport("photo.jpg", (1, 2, 3, 4), "cut by the photo's edge"),),
        phases={"read": 1.5},
    )
    return replace(given, **changes)


def test_report_begins_with_the_keys_of_the_paper(tmp_path):
    write_report(report(), tmp_path / "r.json")
    read = json.loads((tmp_path / "r.json").read_text())
    assert list(read)[: len(FIRST_KEYS)] == FIRST_KEYS
    assert (read["b"], read["v"], read["k"], read["n"], read["grid"]) == (1, 63, 19, 6100, [64, 24])
    assert list(read["T_words"]) == ["min", "avg", "max"] and read["T_words"]["avg"] == 25_000_000
    assert read["ratio"] == {"min": 10.0, "avg": 25.0, "max": 50.0}
    assert read["compressed_ratio"] == 5.0
    assert read["bytes"] == 18


def test_report_of_an_empty_ground_is_valid_json(tmp_path):
    write_report(report(n=0, explicit=ExplicitWords(0.0, 0.0, 0.0), compressed=None), tmp_path / "r.json")
    read = json.loads((tmp_path / "r.json").read_text())
    assert read["compressed_ratio"] is None and read["ratio"]["avg"] is None


def test_lines_for_people():
    assert describe(report()) == (
        "ground.usda: 6100 umbrellas of 1 base on 64 x 24 cells, 18 bytes; as sharp as 10000 x 2500 texels, "
        "25.0 times the words"
    )
    assert "0 umbrellas" in describe(report(n=0))
    assert "1 umbrella of" in describe(report(n=1))
    many = [DroppedReport("a.jpg", None, "no element found")] * 8
    assert describe_dropped(many)[0] == "a.jpg: left out: no element found"
    assert describe_dropped(many)[-1] == "... and 3 more (in --report)" and len(describe_dropped(many)) == 6
