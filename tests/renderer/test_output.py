"""Image files: round trips, what each format shows, what is refused."""

from __future__ import annotations

import os

import numpy as np
import pytest

from fexel.errors import FexelError
from fexel.images import linear_to_srgb
from fexel.renderer.aov import AOVS
from fexel.renderer.encoding import ColorCorrection, visible_data
from fexel.renderer.output import FORMATS, check_output, file_names, write_images


@pytest.fixture
def images(rng):
    """All AOVs of an odd-sized frame, colour premultiplied and partly above 1."""
    shape = (37, 23)
    result = {name: rng.uniform(-1, 5, (*shape, len(aov.channels))).astype("f4") for name, aov in AOVS.items()}
    alpha = rng.uniform(0, 1, (*shape, 1)).astype("f4")
    result["color"] = np.concatenate([rng.uniform(0, 2, (*shape, 3)) * alpha, alpha], -1).astype("f4")
    result["color"][:5] = 0
    result["alpha"] = result["color"][..., 3:]
    result["primId"] = rng.integers(-1, 10**6, (*shape, 1)).astype("f4")
    return result


def read(path):
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    assert source, oiio.geterror()
    spec = source.spec()
    # OpenImageIO would premultiply what a PNG stores straight.
    pixels = source.read_image(spec.format if spec.format.basetype != oiio.HALF else oiio.FLOAT)
    source.close()
    return pixels, spec


def test_exr_keeps_every_aov_under_its_channel_names(images, tmp_path):
    import OpenImageIO as oiio

    path = tmp_path / "all.exr"
    assert write_images(path, images) == [path]
    buffer = oiio.ImageBuf(str(path))
    names = list(buffer.spec().channelnames)
    assert names[:4] == ["R", "G", "B", "A"]
    pixels = buffer.get_pixels(oiio.FLOAT)
    for aov in AOVS.values():
        stored = [suffix if aov.name == "color" else f"{aov.name}.{suffix}" for suffix in aov.channels]
        got = np.stack([pixels[..., names.index(channel)] for channel in stored], -1)
        tolerance = 1e-3 if aov.name in ("color", "alpha") else 0
        np.testing.assert_allclose(got, images[aov.name], rtol=tolerance, atol=tolerance * 1e-3, err_msg=aov.name)


@pytest.mark.parametrize("name", ["all.exr", "color.png", "color.tif"])
def test_same_picture_makes_the_same_bytes_at_another_time(images, tmp_path, move_clock, name):
    written = []
    for _ in range(2):
        write_images(tmp_path / name, images if name == "all.exr" else {"color": images["color"]})
        written.append((tmp_path / name).read_bytes())
        move_clock()
    assert written[0] == written[1]


def test_exr_of_data_alone_has_no_colour(images, tmp_path):
    write_images(tmp_path / "d.exr", {"depth": images["depth"]})
    pixels, spec = read(tmp_path / "d.exr")
    assert tuple(spec.channelnames) == ("depth.Z",) and np.array_equal(pixels.reshape(37, 23, 1), images["depth"])


def test_png_holds_srgb_and_straight_alpha(images, tmp_path):
    path = tmp_path / "c.png"
    write_images(path, {"color": images["color"]})
    import OpenImageIO as oiio

    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    buffer = oiio.ImageBuf(str(path), 0, 0, config)
    pixels = buffer.get_pixels(oiio.UINT8)
    color = images["color"]
    alpha = color[..., 3:]
    straight = np.divide(color[..., :3], alpha, out=np.zeros_like(color[..., :3]), where=alpha > 0)
    expected = np.round(255 * np.clip(np.concatenate([linear_to_srgb(straight), alpha], -1), 0, 1))
    assert np.abs(pixels.astype(int) - expected).max() <= 1


def test_jpeg_shows_the_colour_over_black(tmp_path):
    color = np.zeros((16, 16, 4), "f4")
    color[..., :3], color[..., 3] = 0.25, 0.5
    write_images(tmp_path / "c.jpg", {"color": color})
    pixels, spec = read(tmp_path / "c.jpg")
    assert spec.nchannels == 3
    # Straight 0.5 is encoded, then premultiplied by 0.5.
    assert np.abs(pixels.astype(int) - round(255 * 0.5 * float(linear_to_srgb(np.float32(0.5))))).max() <= 2


@pytest.mark.parametrize("extension", FORMATS)
def test_every_format_can_be_written_and_read(images, tmp_path, extension):
    path = tmp_path / f"image{extension}"
    written = write_images(path, images)
    for file in written:
        pixels, spec = read(file)
        assert (spec.height, spec.width) == (37, 23) and np.all(np.isfinite(pixels.astype("f8")))
    assert sorted(tmp_path.iterdir()) == sorted(written), "nothing else is left"


def test_tiff_has_16_bits(images, tmp_path):
    write_images(tmp_path / "c.tif", {"color": images["color"]})
    assert str(read(tmp_path / "c.tif")[1].format) == "uint16"


def test_linear_formats_are_not_encoded_unless_asked(tmp_path):
    color = np.full((4, 4, 4), 0.5, "f4")
    color[..., 3] = 1
    for name, mode, expected in (
        ("a.exr", None, 0.5),
        ("b.hdr", None, 0.5),
        ("c.exr", "sRGB", float(linear_to_srgb(np.float32(0.5)))),
    ):
        write_images(tmp_path / name, {"color": color}, mode)
        np.testing.assert_allclose(read(tmp_path / name)[0][0, 0, :3], expected, rtol=5e-3)
    write_images(tmp_path / "d.png", {"color": color}, "disabled")
    assert np.all(read(tmp_path / "d.png")[0][..., :3] == 128)


def test_names_of_one_file_per_aov():
    names = file_names("out/name.0001.png", ("color", "depth", "normal"))
    assert {key: path.name for key, path in names.items()} == {
        "color": "name.0001.png",
        "depth": "name.0001.depth.png",
        "normal": "name.0001.normal.png",
    }
    assert file_names("a.png", ("depth",))["depth"].name == "a.png"
    assert len(set(file_names("a.exr", ("color", "depth")).values())) == 1


@pytest.mark.parametrize("name", AOVS)
def test_visible_data_stay_in_range(images, name):
    if name == "color":
        return
    from fexel.renderer.encoding import data_range

    image = images[name] if name not in ("normal", "Neye", "depth") else np.clip(images[name], -1, 1)
    shown = visible_data(name, image, data_range(name, image))
    assert np.all(np.isfinite(shown)) and shown.shape[:2] == image.shape[:2]
    if name not in ("depth", "alpha"):
        assert shown.min() >= 0 and shown.max() <= 1


def test_ids_get_distinct_colours_and_nothing_is_black():
    ids = np.arange(-1, 50, dtype="f4").reshape(1, -1, 1)
    colors = np.round(255 * visible_data("primId", ids, (np.zeros(1), np.ones(1))))
    assert not colors[0, 0].any() and len(np.unique(colors[0], axis=0)) == 51


def test_srgb_is_the_standards_curve():
    known = {0.0: 0.0, 0.0031308: 0.04045, 0.214041: 0.5, 1.0: 1.0}
    for linear, encoded in known.items():
        assert linear_to_srgb(np.float32(linear)) == pytest.approx(encoded, abs=1e-5)
    assert linear_to_srgb(np.float32(-0.214041)) == pytest.approx(-0.5, abs=1e-5)


def test_opencolorio_needs_a_configuration(monkeypatch, tmp_path):
    monkeypatch.delenv("OCIO", raising=False)
    with pytest.raises(FexelError, match="OCIO"):
        ColorCorrection("openColorIO")
    broken = tmp_path / "config.ocio"
    broken.write_text("not a configuration")
    monkeypatch.setenv("OCIO", str(broken))
    with pytest.raises(FexelError, match=r"config\.ocio: not a usable") as error:
        ColorCorrection("openColorIO")
    assert "\n" not in str(error.value)


def test_opencolorio_uses_the_default_view(monkeypatch, tmp_path):
    config = tmp_path / "config.ocio"
    config.write_text(
        "ocio_profile_version: 1\n"
        "roles:\n  default: linear\n  scene_linear: linear\n"
        "displays:\n  screen:\n    - !<View> {name: half, colorspace: halved}\n"
        "colorspaces:\n"
        "  - !<ColorSpace> {name: linear}\n"
        "  - !<ColorSpace>\n    name: halved\n"
        "    from_reference: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}\n"
    )
    monkeypatch.setenv("OCIO", str(config))
    corrected = ColorCorrection("openColorIO")(np.full((2, 3, 3), 0.8, "f4"))
    np.testing.assert_allclose(corrected, 0.4, rtol=1e-5)


def test_unknown_mode_lists_the_valid_ones():
    with pytest.raises(FexelError, match="disabled sRGB openColorIO"):
        ColorCorrection("srgb")


@pytest.mark.parametrize(
    ("name", "message"),
    [("a.xyz", r"cannot write \.xyz; expected \.exr"), ("a", "without extension"), ("no/a.png", "does not exist")],
)
def test_unwritable_names_are_refused_before_rendering(tmp_path, name, message):
    with pytest.raises(FexelError, match=message):
        check_output(tmp_path / name)


def test_folder_in_the_files_place_is_refused(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(FexelError, match="is a folder"):
        write_images(tmp_path / "a.png", {"color": np.zeros((2, 2, 4), "f4")})


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FexelError, match="not writable"):
        check_output(tmp_path / "a.png")


def test_failure_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    good = np.full((512 + 44, 2, 4), 0.5, "f4")
    write_images(path, {"color": good})
    before = path.read_bytes()
    from fexel.renderer import output

    corrected = output._corrected

    def fail(color, *arguments, **options):
        if 1 < len(color) < 256:  # the last strip
            raise OSError(28, "No space left on device")
        return corrected(color, *arguments, **options)

    monkeypatch.setattr(output, "_corrected", fail)
    with pytest.raises(FexelError, match=r"a\.png: No space left"):
        write_images(path, {"color": good})
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]
