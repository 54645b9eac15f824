"""Patches placed by hand: where the layout says, with the artist's masks; a faulty layout is told in one line."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

import fexel
from fexel import homography
from fexel.errors import FexelError
from fexel.images import image_info, read_linear
from fexel.textures import extract_texture
from fexel_tools.authoring import ZipmapOptions
from fexel_tools.layout import place_zipmap, read_layout
from tests.authoring.synthetic_photos import write_image

ZIPMAP = "/World/Materials/Zipmap/Texture"


@pytest.fixture
def pictures(tmp_path, rng):
    """A dim root of 200 x 100 pixels and three details."""
    smooth = np.linspace(60, 120, 200)[None, :, None].repeat(100, axis=0).repeat(3, axis=2)
    write_image(tmp_path / "wall.png", smooth.astype(np.uint8))
    for name in ("door", "lock", "sign"):
        pixels = 150 + rng.normal(0, 12, (60, 80, 3))
        write_image(tmp_path / f"{name}.png", np.clip(pixels, 0, 255).astype(np.uint8))
    mask = np.zeros((60, 80, 1), np.uint8)
    mask[20:40, 20:60] = 255
    write_image(tmp_path / "mask.png", mask)
    return tmp_path


def write_layout(folder, **layout):
    (folder / "layout.yaml").write_text(yaml.safe_dump({"root": "wall.png", **layout}), "utf-8")
    return folder / "layout.yaml"


def patches_of(file):
    return {p.prim.GetName(): p for p in fexel.ZipmapTexture(open_stage(file).GetPrimAtPath(ZIPMAP)).GetPatches()}


_OPEN = []


def open_stage(file):
    stage = Usd.Stage.Open(str(file))
    _OPEN.append(stage)  # prims do not keep their stage
    return stage


def corners_in_root(patch):
    """Where the patch's corners lie, in pixels of the root: top left, top right, bottom right, bottom left."""
    st = homography.apply(np.linalg.inv(patch.root_to_patch), np.array([[0, 1], [1, 1], [1, 0], [0, 0.0]]))
    return np.column_stack([st[:, 0] * 200.0, (1.0 - st[:, 1]) * 100.0])


def test_corners_rect_and_matrix_put_a_patch_where_they_say(pictures):
    corners = [[20, 10], [70, 14], [66, 50], [23, 47]]
    layout = write_layout(
        pictures,
        patches=[
            {"file": "door.png", "corners": corners},
            {"file": "sign.png", "rect": [100, 20, 140, 50]},
            {"file": "lock.png", "matrix": [[0.25, 0, 150], [0, 0.25, 60], [0, 0, 1]]},
        ],
    )
    place_zipmap(layout, pictures / "out.usda")
    patches = patches_of(pictures / "out.usda")
    np.testing.assert_allclose(corners_in_root(patches["door"]), corners, atol=1e-9)
    np.testing.assert_allclose(corners_in_root(patches["sign"])[[0, 2]], [[100, 20], [140, 50]], atol=1e-9)
    np.testing.assert_allclose(corners_in_root(patches["lock"])[[0, 2]], [[150, 60], [170, 75]], atol=1e-9)


def test_units_st_count_from_the_lower_left(pictures):
    layout = write_layout(pictures, units="st", patches=[{"file": "door.png", "rect": [0.1, 0.2, 0.3, 0.6]}])
    place_zipmap(layout, pictures / "out.usda")
    np.testing.assert_allclose(
        corners_in_root(patches_of(pictures / "out.usda")["door"])[[0, 2]], [[20, 40], [60, 80]], atol=1e-9
    )


def test_children_are_nested_and_placed_in_the_root(pictures):
    child = {"file": "lock.png", "rect": [30, 20, 50, 35], "name": "Lock 1", "opacity": 0.5}
    layout = write_layout(
        pictures,
        patches=[
            {"file": "door.png", "rect": [20, 10, 100, 70], "children": [child]},
            {"file": "sign.png", "rect": [120, 10, 160, 40]},
        ],
    )
    place_zipmap(layout, pictures / "out.usda")
    patches = patches_of(pictures / "out.usda")
    assert [str(p.path).removeprefix(ZIPMAP) for p in patches.values()] == ["", "/door", "/door/Lock_1", "/sign"]
    np.testing.assert_allclose(corners_in_root(patches["Lock_1"])[[0, 2]], [[30, 20], [50, 35]], atol=1e-9)
    assert patches["Lock_1"].opacity == 0.5


def test_hand_made_mask_replaces_the_automatic_one(pictures):
    layout = write_layout(pictures, patches=[{"file": "door.png", "rect": [20, 10, 100, 70], "mask": "mask.png"}])
    place_zipmap(layout, pictures / "out.usda")
    patch = patches_of(pictures / "out.usda")["door"]
    mask = patch.prim.GetAttribute("inputs:mask").Get()
    assert mask.path == "./out_textures/door_mask.png"
    np.testing.assert_allclose(read_linear(mask.resolvedPath, "raw")[:, :, 0].mean(), 800 / 4800, atol=1e-6)
    assert image_info(patch.prim.GetAttribute("inputs:file").Get().resolvedPath).alpha_channel == -1


def test_colours_are_matched_unless_they_are_to_be_kept(pictures):
    for colors in ("match", "keep"):
        layout = write_layout(pictures, patches=[{"file": "door.png", "rect": [20, 10, 100, 70], "colors": colors}])
        place_zipmap(layout, pictures / f"{colors}.usda")
    original = read_linear(str(pictures / "door.png"))[..., :3].mean()
    below = read_linear(str(pictures / "wall.png"))[10:70, 20:100, :3].mean()

    def inner_mean(name):
        texture = read_linear(str(pictures / f"{name}_textures/door.tif"))
        inner = texture[15:-15, 15:-15]
        return (inner[..., :3] / np.maximum(inner[..., 3:], 1e-6)).mean()

    assert inner_mean("keep") == pytest.approx(original, rel=0.02)
    assert inner_mean("match") == pytest.approx(below, rel=0.08)


DOOR = "{root: wall.png, patches: [{file: door.png, "


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ("{root: wall.png, patches: [{file: gone.png, rect: [1, 2, 3, 4]}]}", r"patches\[0\]: gone.png: no such file"),
        ("{root: wall.png, patches: [{file: door.png}]}", r"patches\[0\]: expected one of corners, rect, matrix"),
        (DOOR + "rect: [1, 2, 3]}]}", "rect must be 4 finite numbers"),
        (DOOR + "rect: [1, 2, 3, .nan]}]}", "rect must be 4 finite numbers"),
        (DOOR + "rect: [5, 5, 5, 9]}]}", "singular|line"),
        (DOOR + "rect: [500, 5, 600, 9]}]}", "outside the root"),
        (DOOR + "corners: [[0, 0], [9, 9], [9, 0], [0, 9]]}]}", "corners cross|infinity"),
        (DOOR + "rect: [0, 0, 9, 9], opacity: 2}]}", "opacity is 2, expected 0 to 1"),
        (DOOR + "rect: [0, 0, 9, 9], colours: keep}]}", "unknown key 'colours'"),
        ("{root: wall.png, units: cm}", "units is 'cm', expected pixels or st"),
        ("{root: wall.png, patches: 7}", "expected a list of patches"),
        ("{patches: []}", "expected a mapping with the keys root and patches"),
        ("[1, 2", "is not YAML"),
    ],
)
def test_faulty_layout_is_told_in_one_line_and_nothing_is_written(pictures, layout, message):
    (pictures / "layout.yaml").write_text(layout, "utf-8")
    before = sorted(pictures.iterdir())
    with pytest.raises(FexelError, match=message) as error:
        place_zipmap(pictures / "layout.yaml", pictures / "out.usda")
    assert "\n" not in str(error.value)
    assert "layout.yaml" in str(error.value)
    assert sorted(pictures.iterdir()) == before


def test_layout_without_patches_is_the_root_alone(pictures):
    root, patches = read_layout(write_layout(pictures), ZipmapOptions())
    assert patches == []
    assert root.window == (0, 0, 200, 100)


@pytest.fixture
def placed_stage(pictures):
    """An artist's stage: own geometry, two nested patches, one of them masked by hand."""
    stage = Usd.Stage.CreateNew(str(pictures / "art.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/Set").GetPrim())
    root = fexel.ZipmapTexture.Define(stage, "/Set/Wall")
    root.CreateFileAttr(Sdf.AssetPath("./wall.png"))
    door = fexel.ZipmapTexture.Define(stage, "/Set/Wall/Door")
    door.CreateFileAttr(Sdf.AssetPath("./door.png"))
    door.CreateMatrixAttr(Gf.Matrix3d(2, 0, 0, 0, 2, 0, -0.2, -0.4, 1))
    lock = fexel.ZipmapTexture.Define(stage, "/Set/Wall/Door/Lock")
    lock.CreateFileAttr(Sdf.AssetPath("./lock.png"))
    lock.CreateMatrixAttr(Gf.Matrix3d(3, 0, 0, 0, 3, 0, -1, -1, 1))
    lock.CreateMaskAttr(Sdf.AssetPath("./mask.png"))
    stage.WriteFallbackPrimTypes()
    stage.Save()
    return pictures / "art.usda"


def test_stage_placed_by_hand_is_completed_by_a_layer_over_it(placed_stage, pictures):
    before = placed_stage.read_bytes()
    place_zipmap(placed_stage, pictures / "done.usda", ZipmapOptions(fallback_size=64))
    assert placed_stage.read_bytes() == before
    stage = open_stage(pictures / "done.usda")
    assert stage.GetRootLayer().subLayerPaths[:] == ["./art.usda"]
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetDefaultPrim().GetPath() == "/Set"
    patches = fexel.ZipmapTexture(stage.GetPrimAtPath("/Set/Wall")).GetPatches()
    files = [p.prim.GetAttribute("inputs:file").Get() for p in patches]
    assert [f.path for f in files] == ["./wall.png", "./done_textures/Door.tif", "./done_textures/Lock.tif"]
    assert all(f.resolvedPath for f in files)
    assert image_info(files[1].resolvedPath).alpha_channel == 3
    assert image_info(files[2].resolvedPath).alpha_channel == -1
    np.testing.assert_array_equal(np.array(patches[1].prim.GetAttribute("inputs:matrix").Get())[2], (-0.2, -0.4, 1))
    fallback = stage.GetPrimAtPath("/Set/Wall/Fallback").GetAttribute("inputs:file").Get()
    info = image_info(fallback.resolvedPath)
    assert max(info.width, info.height) <= 64


def test_stage_without_zipmap_or_with_a_singular_matrix_is_refused(placed_stage, pictures):
    stage = Usd.Stage.CreateNew(str(pictures / "bare.usda"))
    stage.Save()
    with pytest.raises(FexelError, match="holds no ZipmapTexture"):
        place_zipmap(pictures / "bare.usda", pictures / "out.usda")
    stage = Usd.Stage.Open(str(placed_stage))
    stage.GetPrimAtPath("/Set/Wall/Door").GetAttribute("inputs:matrix").Set(Gf.Matrix3d(0.0))
    stage.Save()
    with pytest.raises(FexelError, match=r"/Set/Wall/Door.*singular"):
        place_zipmap(placed_stage, pictures / "out.usda")
    assert not (pictures / "out.usda").exists()


def test_inputs_in_the_folder_of_textures_are_kept(placed_stage, pictures):
    """Even where the earlier output names them: pictures, masks, and the layout's own layers."""
    (pictures / "own_textures").mkdir()
    for name in ("wall", "door"):
        (pictures / f"{name}.png").rename(pictures / "own_textures" / f"{name}.png")
    stage = Usd.Stage.CreateNew(str(pictures / "own.usda"))
    for name in ("wall", "door"):
        texture = fexel.ZipmapTexture.Define(stage, "/wall" if name == "wall" else "/wall/door")
        texture.CreateFileAttr(Sdf.AssetPath(f"./own_textures/{name}.png"))
    stage.Save()
    layout = pictures / "layout.yaml"
    layout.write_text("{root: own_textures/wall.png, patches: []}", "utf-8")
    art = Usd.Stage.CreateNew(str(pictures / "over.usda"))
    art.GetRootLayer().subLayerPaths[:] = ["./own.usda"]
    art.Save()
    for place, message in ((layout, "wall.png: lies in"), (pictures / "over.usda", "is an input")):
        with pytest.raises(FexelError, match=message):
            place_zipmap(place, pictures / "own.usda", ZipmapOptions(fallback_size=16))
    assert {p.name for p in (pictures / "own_textures").iterdir()} == {"wall.png", "door.png"}


@pytest.mark.parametrize("damage", ["text", "cut"])
def test_unreadable_mask_is_told_before_the_work(placed_stage, pictures, damage, monkeypatch):
    whole = (pictures / "mask.png").read_bytes()
    (pictures / "mask.png").write_bytes(b"no picture" if damage == "text" else whole[: len(whole) // 2])
    layout = write_layout(pictures, patches=[{"file": "door.png", "rect": [20, 10, 100, 70], "mask": "mask.png"}])
    for module in ("authoring", "placed_stage"):
        monkeypatch.setattr(f"fexel_tools.{module}.write_textures", lambda *a, **k: pytest.fail("work was begun"))
    for place in (layout, placed_stage):
        with pytest.raises(FexelError, match=r"mask\.png"):
            place_zipmap(place, pictures / "out.usda")


def test_layout_that_holds_itself_is_told_in_one_line(pictures):
    (pictures / "layout.yaml").write_text(
        "{root: wall.png, patches: &p [{file: door.png, rect: [1, 2, 9, 9], children: *p}]}", "utf-8"
    )
    with pytest.raises(FexelError, match=r"patches\[0\]\.children\[0\]: is its own descendant"):
        place_zipmap(pictures / "layout.yaml", pictures / "out.usda")


@pytest.mark.parametrize(
    "place",
    [
        {"matrix": [[0, 0, 0]] * 3},
        {"matrix": [[1e308, 0, 0], [0, 1e308, 0], [0, 0, 0]]},
        {"corners": [[1e308, 0], [-1e308, 3], [1e308, -1e308], [0, 9]]},
    ],
)
@pytest.mark.filterwarnings("error")
def test_placement_without_an_inverse_is_told_without_warnings(pictures, place):
    layout = write_layout(pictures, patches=[{"file": "door.png", **place}])
    with pytest.raises(FexelError, match=r"patches\[0\]: the placement is singular"):
        place_zipmap(layout, pictures / "out.usda")


def test_stages_are_written_without_a_word_from_usd(placed_stage, pictures, capfd):
    place_zipmap(placed_stage, pictures / "done.usda", ZipmapOptions(fallback_size=16))
    layout = write_layout(pictures, patches=[{"file": "door.png", "rect": [20, 10, 100, 70]}])
    mesh = Usd.Stage.CreateNew(str(pictures / "mesh.usda"))
    from fexel_tools.geometry import define_surface, primitive

    mesh.SetDefaultPrim(UsdGeom.Xform.Define(mesh, "/M").GetPrim())
    define_surface(mesh, "/M/Quad", primitive("quad", 2.0), UsdShade.Material.Define(mesh, "/M/Old"))
    mesh.Save()
    place_zipmap(layout, pictures / "out.usda", ZipmapOptions(fallback_size=16, mesh=str(pictures / "mesh.usda")))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("way", ["metadata", "connected", "connected space"])
def test_colour_space_and_connection_of_a_file_count_as_they_do_for_the_renderer(placed_stage, pictures, way):
    """The door's picture is said to be raw, or comes over a connection; what is written shows it so."""
    stage = open_stage(placed_stage)
    door = fexel.ZipmapTexture(stage.GetPrimAtPath("/Set/Wall/Door"))
    if way == "metadata":
        door.GetFileAttr().SetColorSpace("raw")
    elif way == "connected":
        graph = UsdShade.NodeGraph.Define(stage, "/Set/Graph")
        file = graph.CreateInput("picture", Sdf.ValueTypeNames.Asset)
        file.Set(Sdf.AssetPath("./sign.png"))
        file.GetAttr().SetColorSpace("raw")
        door.GetFileAttr().Set(Sdf.AssetPath("./door.png"))
        UsdShade.Input(door.GetFileAttr()).ConnectToSource(file)
    else:
        graph = UsdShade.NodeGraph.Define(stage, "/Set/Graph")
        space = graph.CreateInput("space", Sdf.ValueTypeNames.Token)
        space.Set("raw")
        UsdShade.Input(door.CreateSourceColorSpaceAttr()).ConnectToSource(space)
    stage.Save()
    place_zipmap(placed_stage, pictures / "done.usda", ZipmapOptions(fallback_size=16, match_colors=False))
    done = open_stage(pictures / "done.usda")
    _, data = extract_texture(done.GetPrimAtPath("/Set/Wall"), Usd.TimeCode.Default())
    source = data.sources[data.source_index[1]]
    assert source.file == str(pictures / "done_textures" / "Door.tif")
    shown = read_linear(source.file, source.color_space)[28:32, 38:42]
    original = read_linear(str(pictures / ("sign.png" if way == "connected" else "door.png")), "raw")[28:32, 38:42]
    np.testing.assert_allclose(shown[..., :3] / shown[..., 3:], original[..., :3], atol=0.01)
