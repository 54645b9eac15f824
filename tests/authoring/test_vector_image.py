"""SVG to pixels: aspect, alpha, colours, and what a drawing must not do."""

import gzip
import warnings

import numpy as np
import pytest

from fexel.errors import FexelError, FexelWarning
from fexel_tools import vector_image
from fexel_tools.vector_image import is_vector_image, rasterize

_OPEN = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '


@pytest.fixture
def svg(tmp_path):
    def write(markup, name="drawing.svg"):
        path = tmp_path / name
        path.write_bytes(markup if isinstance(markup, bytes) else markup.encode())
        return path

    return write


@pytest.mark.parametrize(
    ("size", "shape"),
    [
        ('viewBox="0 0 30 20"', (43, 64)),
        ('viewBox="0 0 20 30"', (64, 43)),
        ('width="210mm" height="297mm"', (64, 45)),
        ('width="220pt" height="110pt"', (32, 64)),
        ('width="100%" height="100%" viewBox="0 0 10 5"', (32, 64)),
        ('width="1e9" height="1e9"', (64, 64)),
        ('width="1000000mm" height="1mm"', (1, 64)),
    ],
)
def test_declared_sizes_give_the_aspect_only(svg, size, shape):
    path = svg(f'{_OPEN}{size}><rect width="100%" height="100%"/></svg>')
    alpha = rasterize(path, 64)[..., 3]
    assert max(alpha.shape) == 64
    assert np.abs(np.subtract(alpha.shape, shape)).max() <= 1  # resvg rounds up
    assert (alpha == 255).all()  # to the last row


def test_the_ground_is_transparent_and_colour_is_straight(svg):
    path = svg(f'{_OPEN}viewBox="0 0 8 8"><rect width="4" height="8" fill="#c08040" opacity="0.5"/></svg>')
    pixels = rasterize(path, 64)
    assert (pixels[:, :32, 3] == 128).all()
    assert np.abs(pixels[:, :32, :3].astype(int) - (0xC0, 0x80, 0x40)).max() <= 1
    assert not pixels[:, 32:].any()


def test_coverage_of_an_edge_is_its_area(svg):
    """A half-plane at a slope: alpha summed over the picture is its area, and over rows it grows by the slope."""
    path = svg(f'{_OPEN}viewBox="0 0 64 64"><path d="M0 0H20.3L30.9 64H0Z"/></svg>')
    alpha = rasterize(path, 64)[..., 3] / 255
    rows = 20.3 + (30.9 - 20.3) * (np.arange(64) + 0.5) / 64
    assert np.abs(alpha.sum(axis=1) - rows).max() < 0.15  # resvg samples 4 lines a pixel
    assert abs((alpha.sum(axis=1) - rows).mean()) < 0.02


def test_style_sheets_symbols_and_current_color_are_followed(svg):
    path = svg(
        f'{_OPEN}viewBox="0 0 4 1" color="#00ff00"><style>.a {{ fill: #ff0000 }}</style>'
        '<symbol id="s" viewBox="0 0 1 1"><rect width="1" height="1" fill="#0000ff"/></symbol>'
        '<rect class="a" width="1" height="1"/><use xlink:href="#s" x="1" width="1" height="1"/>'
        '<rect x="2" width="1" height="1" fill="currentColor"/></svg>'
    )
    pixels = rasterize(path, 64)[8]
    assert [pixels[x].tolist() for x in (8, 24, 40, 56)] == [
        [255, 0, 0, 255],
        [0, 0, 255, 255],
        [0, 255, 0, 255],
        [0, 0, 0, 0],
    ]


@pytest.mark.parametrize("prefix", ["", "file://"])
def test_files_that_a_drawing_refers_to_are_not_read(svg, tmp_path, prefix):
    other = svg(f'{_OPEN}viewBox="0 0 1 1"><rect width="1" height="1"/></svg>', "secret.svg")
    for href in (f"{prefix}{other}", "secret.svg", "../secret.svg", "https://example.org/a.png"):
        path = svg(
            f'{_OPEN}viewBox="0 0 8 8"><rect width="1" height="1"/><image xlink:href="{href}" width="8" height="8"/>'
            "</svg>"
        )
        with pytest.warns(FexelWarning, match=r"drawing\.svg: '.*' is outside the file") as caught:
            pixels = rasterize(path, 16)
        assert len(caught) == 1
        assert not pixels[4:, 4:].any()


def test_entities_cannot_read_files_or_explode(svg):
    outside = svg('<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/hostname">]>' + _OPEN + "><text>&x;</text></svg>")
    with pytest.raises(FexelError, match=r"drawing\.svg: not well-formed XML: undefined entity"):
        rasterize(outside, 16)
    levels = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    bomb = svg(f'<!DOCTYPE svg [<!ENTITY e0 "xxxxxxxxxx">{levels}]>{_OPEN}><text>&e11;</text></svg>')
    with pytest.raises(FexelError, match=r"drawing\.svg: not well-formed XML"):
        rasterize(bomb, 16)


def test_internal_entities_as_illustrator_writes_them_are_expanded(svg):
    path = svg(
        '<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY st0 "fill:#ff8000"><!ENTITY ns "http://www.w3.org/2000/svg">]>'
        '<svg xmlns="&ns;" viewBox="0 0 1 1"><rect style="&st0;" width="1" height="1"/></svg>'
    )
    assert (rasterize(path, 16) == (255, 128, 0, 255)).all()


@pytest.mark.parametrize(
    ("markup", "message"),
    [
        (_OPEN + "><rect></svg>", "not well-formed XML: mismatched tag"),
        ("hello", "not well-formed XML: syntax error"),
        ("", "not well-formed XML: no element found"),
        (b"\x00\xff\xfe\x00", "not well-formed XML"),
        ("<html/>", "the root element is 'html', expected 'svg'"),
        (_OPEN + 'width="0" height="5"><rect width="1" height="1"/></svg>', "cannot be drawn: SVG has an invalid size"),
        (_OPEN + 'viewBox="0 0 1 1">' + "<g>" * 900 + "</g>" * 900 + "</svg>", "elements nested too deeply"),
    ],
)
def test_broken_drawings_are_one_line_errors_that_name_the_file(svg, markup, message):
    with pytest.raises(FexelError, match=rf"drawing\.svg: ({message})") as caught:
        rasterize(svg(markup), 16)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(FexelError, match=r"none\.svg: no such file"):
        rasterize(tmp_path / "none.svg", 16)


def test_compressed_drawings_are_read_and_damaged_ones_said(svg):
    data = gzip.compress(f'{_OPEN}viewBox="0 0 1 1"><rect width="1" height="1"/></svg>'.encode())
    path = svg(data, "drawing.svgz")
    assert is_vector_image(path)
    assert (rasterize(path, 16)[..., 3] == 255).all()
    with pytest.raises(FexelError, match=r"short\.svgz: damaged gzip data"):
        rasterize(svg(data[:40], "short.svgz"), 16)


def test_an_empty_drawing_is_transparent(svg):
    assert not rasterize(svg(f'{_OPEN}viewBox="0 0 2 1"/>'), 32).any()


def test_text_without_a_font_is_said(svg, monkeypatch):
    monkeypatch.setattr("fexel_tools.vector_image._installed_families", dict)
    path = svg(f'{_OPEN}viewBox="0 0 9 9"><text y="8">a</text><rect width="1" height="1"/></svg>')
    with pytest.warns(FexelWarning, match=r"drawing\.svg: has text and no font"):
        rasterize(path, 16)


def test_text_is_drawn_in_a_font_that_is_there(svg):
    if not vector_image._installed_families():
        pytest.skip("no font on this machine")
    path = svg(f'{_OPEN}viewBox="0 0 60 20"><text y="16" font-size="16" font-family="No Such Font">Text</text></svg>')
    assert rasterize(path, 60)[..., 3].any()


def test_shared_drawings_are_all_drawn(shared_data):
    files = sorted((shared_data / "pinch").glob("*/*.svg"))
    assert len(files) >= 32
    for file in files:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            alpha = rasterize(file, 128)[..., 3] / 255
        assert max(alpha.shape) == 128
        assert 0.03 < alpha.mean() < 0.9, file.name
