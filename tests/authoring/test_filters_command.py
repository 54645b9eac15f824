"""``fexel filters``: figures and pictures of all filters on any image; one line where something is wrong."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio
import pytest
from typer.testing import CliRunner

from fexel.errors import FexelError, FexelWarning
from fexel.images import read_linear
from fexel.renderer.context import GLContext
from fexel_tools import filter_measure
from fexel_tools.cli import app
from fexel_tools.filter_measure import COMPARED, GAUSS_FIPMAP, memory_ratio
from fexel_tools.filter_report import FilterOptions, compare_filters, summary
from fexel_tools.filter_subject import open_subject
from fexel_tools.filter_textures import line_chart
from fexel_tools.image_files import write_image

MAIN = "from fexel_tools.cli import main; main()"
SMALL = FilterOptions(
    elevations=(45.0, 5.0), azimuths=(0.0, 30.0), filters=("mipmap", "anisotropic", "fipmap"), pixels=16
)


@pytest.fixture
def chart(tmp_path):
    path = tmp_path / "chart.png"
    write_image(path, line_chart(96))
    return path


def saved(path, pixels, color_space="sRGB"):
    write_image(path, pixels, color_space)
    return path


def by_filter(result, truth="box", elevation=5.0):
    filters = dict.fromkeys(figure.filter for figure in result.figures)
    return {
        token: np.mean(
            [f.psnr_db for f in result.figures if (f.filter, f.truth, f.view.elevation) == (token, truth, elevation)]
        )
        for token in filters
    }


def test_report_has_an_entry_for_every_view_filter_and_truth(chart, tmp_path):
    report = tmp_path / "r.json"
    compare_filters([chart], SMALL, report=report)
    data = json.loads(report.read_text())
    keys = {"image", "elevation", "azimuth", "filter", "truth", "psnr_db", "ciede2000", "fetches", "memory"}
    assert all(set(entry) == keys for entry in data["views"])
    places = {(e["elevation"], e["azimuth"], e["filter"], e["truth"]) for e in data["views"]}
    assert len(places) == len(data["views"]) == 2 * 2 * 3 * 2
    assert data["images"][0]["size"] == [96, 96]


def test_filters_rank_as_they_should_on_a_chart_at_a_low_angle(chart):
    error = by_filter(compare_filters([chart], SMALL))
    assert error["mipmap"] + 6 < error["fipmap"]
    assert error["mipmap"] + 6 < error["anisotropic"]


def test_shaders_and_their_twin_give_the_same_figures(chart, monkeypatch):
    shown = compare_filters([chart], SMALL)

    def no_opengl(self):
        raise FexelError("no usable OpenGL")

    monkeypatch.setattr(GLContext, "__enter__", no_opengl)
    with pytest.warns(FexelWarning, match="NumPy"):
        computed = compare_filters([chart], SMALL)
    for gpu, cpu in zip(shown.figures, computed.figures, strict=True):
        assert gpu.psnr_db == pytest.approx(cpu.psnr_db, abs=1.5), (gpu.filter, gpu.view)
        assert gpu.fetches == pytest.approx(cpu.fetches)


def test_sheet_shows_truth_and_filters_with_errors_below(chart, tmp_path):
    sheet = tmp_path / "sheet.png"
    compare_filters([chart], SMALL, sheet=sheet)
    page = read_linear(str(sheet))
    assert page.shape[1] == 6 + 4 * (128 + 6)
    assert page[..., :3].std() > 0.05


def test_title_of_a_sheet_of_one_filter_is_whole(tmp_path):
    name = "a chart of line pairs whose name is longer than a picture is wide.png"
    path = saved(tmp_path / name, line_chart(64))
    titles = []
    for filters in (("mipmap",), ("mipmap", "anisotropic", "ripmap", "fipmap", "ewa", "mipmap")):
        sheet = tmp_path / f"{len(filters)}.png"
        compare_filters([path], replace(SMALL, filters=filters, elevations=(45.0,)), sheet=sheet)
        titles.append(read_linear(str(sheet))[:22, :, 0] > 0.2)
    one, many = titles
    assert many.any(axis=0).nonzero()[0].max() > 6 + 2 * (128 + 6)
    assert one.sum() == many.sum()


def test_small_pictures_stand_above_their_captions_and_the_key_has_the_colours_of_error_maps(chart, tmp_path):
    sheet = tmp_path / "sheet.png"
    compare_filters([chart], replace(SMALL, elevations=(45.0,)), sheet=sheet)
    page = read_linear(str(sheet))[..., :3]
    paper = page[0, 0]
    rows = slice(24 + 58 + 6 + 24, 24 + 58 + 6 + 24 + 16)  # a title and a heading, a label, then pictures
    assert (page[rows, 6 : 6 + 16] != paper).any(axis=(1, 2)).all()
    assert (page[rows, 6 + 16 : 6 + 128] == paper).all()
    assert len(np.unique(page[24 + 47, 6 + 48 : 6 + 92], axis=0)) > 30


def test_texels_that_are_no_numbers_are_named_and_count_as_when_rendered(tmp_path):
    pixels = np.random.default_rng(6).random((32, 32, 3)).astype(np.float32)
    pixels[3, 4], pixels[5, 6, 1] = np.nan, np.inf
    path = saved(tmp_path / "holes.exr", pixels, "raw")
    with pytest.warns(FexelWarning, match=r"holes.exr: 2 of 1024 texels hold NaN or infinity"):
        result = compare_filters([path], SMALL)
    assert all(np.isfinite(figure.psnr_db) for figure in result.figures)


def test_memory_is_that_of_the_table():
    ratios = {token: memory_ratio(token, (1024, 1024), ("repeat", "repeat")) for token in COMPARED}
    assert ratios["mipmap"] == ratios["anisotropic"] == ratios["ewa"] == pytest.approx(4 / 3, abs=1e-3)
    assert ratios["ripmap"] == pytest.approx(4, abs=0.01)
    assert ratios["fipmap"] == pytest.approx(12, abs=0.06)
    assert ratios[GAUSS_FIPMAP] == pytest.approx(17 + 1 / 3, abs=0.15)


def test_gaussian_fipmap_is_compared_with_the_gaussian_truth(chart, tmp_path):
    options = replace(SMALL, filters=("fipmap", GAUSS_FIPMAP), elevations=(5.0,))
    report = compare_filters([chart], options, sheet=tmp_path / "sheet.png")
    found = {(figure.filter, figure.truth, figure.view.azimuth): figure for figure in report.figures}
    for azimuth in options.azimuths:
        gauss = found[GAUSS_FIPMAP, "gauss", azimuth]
        assert gauss.psnr_db > found["fipmap", "gauss", azimuth].psnr_db
        assert gauss.fetches == 20
    line = next(line for line in summary(report) if line.startswith(GAUSS_FIPMAP))
    assert float(line.split()[-1]) == pytest.approx(
        np.mean([found[GAUSS_FIPMAP, "gauss", azimuth].psnr_db for azimuth in options.azimuths]), abs=0.06
    )


@pytest.mark.parametrize(
    ("name", "pixels"),
    [
        ("grey.png", (np.arange(35 * 21).reshape(21, 35, 1) % 251).astype(np.uint8)),
        ("deep.png", (np.random.default_rng(1).random((33, 47, 3)) * 65535).astype(np.uint16)),
        ("alpha.png", (np.random.default_rng(2).random((40, 31, 4)) * 255).astype(np.uint8)),
        ("light.exr", np.random.default_rng(3).random((25, 30, 3)).astype(np.float32) * 8),
        ("line.png", (np.random.default_rng(4).random((1, 77, 3)) * 255).astype(np.uint8)),
        ("dot.png", np.full((1, 1, 3), 99, np.uint8)),
        ("associated.exr", np.random.default_rng(5).random((25, 30, 4)).astype(np.float16)),
    ],
)
def test_every_kind_of_image_is_measured_finite(tmp_path, name, pixels):
    path = saved(tmp_path / name, pixels, "raw" if name.endswith("exr") else "sRGB")
    result = compare_filters([path], SMALL, sheet=tmp_path / "sheet.png")
    assert all(np.isfinite(figure.psnr_db) and figure.psnr_db > 5 for figure in result.figures)
    assert all(figure.fetches >= 4 for figure in result.figures)


def test_bright_images_are_compared_by_their_own_white(tmp_path):
    pixels = np.random.default_rng(3).random((64, 64, 3)).astype(np.float32)
    dim, bright = (saved(tmp_path / f"{k}.exr", k * pixels, "raw") for k in (1, 1000))
    one, other = (by_filter(compare_filters([path], SMALL)) for path in (dim, bright))
    assert one == pytest.approx(other, abs=0.5)


def test_constant_image_has_no_error(tmp_path):
    path = saved(tmp_path / "flat.png", np.full((50, 70, 3), 140, np.uint8))
    result = compare_filters([path], SMALL)
    assert min(figure.psnr_db for figure in result.figures) > 60


# A clamped fipmap goes on beyond the border with that of its coarse images, not with the border texel itself.
@pytest.mark.parametrize(("wrap", "least"), [("mirror", 35), ("clamp", 22), ("black", 35)])
def test_borders_are_filtered_as_what_they_are(chart, wrap, least):
    error = by_filter(compare_filters([chart], replace(SMALL, wrap=wrap)))
    assert error["anisotropic"] > 35
    assert error["fipmap"] > least


def test_normal_maps_are_compared_as_vectors(tmp_path):
    rng = np.random.default_rng(8)
    slopes = rng.normal(0, 0.4, (64, 64, 2))
    normals = np.dstack([slopes, np.ones((64, 64))])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    path = saved(tmp_path / "normal.png", np.rint((normals + 1) * 127.5).astype(np.uint8), "raw")
    result = compare_filters([path], replace(SMALL, normal_map=True))
    assert all(figure.ciede2000 is None for figure in result.figures)
    error = by_filter(result)
    assert error["fipmap"] > error["mipmap"]


def test_only_the_middle_of_a_large_image_is_taken(tmp_path):
    path = saved(tmp_path / "large.png", np.random.default_rng(6).integers(0, 255, (90, 200, 3), np.uint8))
    subject = open_subject(str(path), tmp_path, largest=64, wrap="repeat")
    assert subject.window == (68, 13, 132, 77)
    whole = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    copied = oiio.ImageBuf(subject.source.file).get_pixels(oiio.UINT8)
    assert np.array_equal(whole[13:77, 68:132], copied)


def test_nothing_is_left_beside_the_image(chart):
    compare_filters([chart], SMALL)
    assert os.listdir(chart.parent) == [chart.name]


def test_summary_has_a_line_per_filter(chart):
    lines = summary(compare_filters([chart], SMALL))
    assert [line.split()[0] for line in lines] == ["filter", *SMALL.filters]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["missing.png"], "missing.png: no such file"),
        (["broken.png"], "broken.png"),
        (["chart.png", "--elevations", "0"], "--elevations: 0"),
        (["chart.png", "--elevations", "a,b"], "--elevations: 'a,b'"),
        (["chart.png", "--azimuths", ""], "azimuth"),
        (["chart.png", "--filters", "bicubic"], "'bicubic'"),
        (["chart.png", "--wrap", "tile"], "'tile'"),
        (["chart.png", "--size", "4"], "--size: 4"),
        (["chart.png", "--anisotropy", "nan"], "--anisotropy: nan"),
        (["chart.png", "--sheet", "chart.png"], "chart.png"),
        (["chart.png", "--sheet", "sheet.bmp"], "expected .png"),
        (["chart.png", "--report", "nowhere/r.json"], "nowhere"),
    ],
)
def test_what_is_wrong_is_one_error_and_nothing_is_written(chart, arguments, named):
    (chart.parent / "broken.png").write_bytes(chart.read_bytes()[:500])
    before = sorted(os.listdir(chart.parent)), chart.read_bytes()
    given = [str(chart.parent / word) if "." in word or "/" in word else word for word in arguments]
    result = CliRunner().invoke(
        app, ["filters", *given, *([] if "--report" in given else ["--report", str(chart.parent / "r.json")])]
    )
    assert result.exit_code != 0
    assert isinstance(result.exception, FexelError)
    assert named in str(result.exception)
    assert "\n" not in str(result.exception)
    assert (sorted(os.listdir(chart.parent)), chart.read_bytes()) == before


def test_command_prints_the_table_and_writes_both_files(chart, tmp_path):
    words = ["--sheet", "s.png", "--report", "r.json", "--elevations", "10", "--azimuths", "15", "--size", "16"]
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "from fexel_tools.cli import main; main()",
            "filters",
            str(chart),
            "--filters",
            "mipmap,ripmap",
            *words,
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "ripmap" in done.stdout
    assert len(json.loads((tmp_path / "r.json").read_text())["views"]) == 4
    assert (tmp_path / "s.png").is_file()


def test_the_gaussian_truth_is_measured_at_fewer_pixels(chart):
    assert len(filter_measure._some(128 * 128)) == filter_measure.GAUSS_PIXELS
    assert filter_measure._some(10).tolist() == list(range(10))
