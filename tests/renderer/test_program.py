"""The GLSL loader: includes, line numbers, what may become a define."""

from __future__ import annotations

import pytest

from fexel.errors import FexelError
from fexel.renderer.program import ProgramCache, load_shader

VERTEX = "void main()\n{\n    gl_Position = vec4(0.0);\n}\n"


def write(folder, **files):
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(text)


def test_includes_nest_and_each_file_is_read_once(tmp_path):
    write(tmp_path, a__glsl='#include "b.glsl"\nfloat a;\n', b__glsl="float b;\n")
    write(tmp_path, main__frag='#include "a.glsl"\n#include "b.glsl"\nvoid main() {}\n')
    source = load_shader("main.frag", folder=tmp_path)
    assert source.text.count("float b;") == 1
    assert source.files == ("<defines>", "main.frag", "a.glsl", "b.glsl")
    assert source.text.index("float b;") < source.text.index("float a;") < source.text.index("void main")


def test_files_that_include_each_other_end(tmp_path):
    write(tmp_path, a__glsl='#include "b.glsl"\n', b__glsl='#include "a.glsl"\nfloat b;\n')
    assert load_shader("a.glsl", folder=tmp_path).text.count("float b;") == 1


@pytest.mark.parametrize(
    ("nested", "place"),
    [
        ("float b(\n", "b.glsl:2"),
        ("float b()\n{\n    return missing;\n}\n", "b.glsl:3"),
    ],
)
def test_compile_error_names_file_and_line_of_a_nested_include(gl, tmp_path, nested, place):
    write(
        tmp_path,
        mesh__vert=VERTEX,
        b__glsl=nested,
        a__glsl='// a\n#include "b.glsl"\nfloat a;\n',
    )
    write(
        tmp_path,
        mesh__frag='out vec4 c;\n#include "a.glsl"\nvoid main()\n{\n    c = vec4(b());\n}\n',
    )
    with pytest.raises(FexelError) as error:
        ProgramCache(gl, tmp_path).get("mesh.vert", "mesh.frag")
    assert place in str(error.value) or (place == "b.glsl:2" and "a.glsl:3" in str(error.value))
    assert "\n" not in str(error.value)


def test_compile_error_after_an_include_keeps_its_own_line(gl, tmp_path):
    write(tmp_path, mesh__vert=VERTEX, a__glsl="float a;\nfloat b;\nfloat c2;\n")
    write(
        tmp_path,
        mesh__frag='out vec4 c;\n#include "a.glsl"\nvoid main()\n{\n    c = missing;\n}\n',
    )
    with pytest.raises(FexelError, match=r"mesh\.frag:5: .*missing"):
        ProgramCache(gl, tmp_path).get("mesh.vert", "mesh.frag", {"UNUSED": 1, "USED": 2.5})


def test_error_in_the_vertex_shader_names_the_vertex_shader(gl, tmp_path):
    write(tmp_path, mesh__vert="void main()\n{\n    gl_Position = nothing;\n}\n")
    write(tmp_path, mesh__frag="out vec4 c;\nvoid main() { c = vec4(1.0); }\n")
    with pytest.raises(FexelError, match=r"mesh\.vert:3: .*nothing"):
        ProgramCache(gl, tmp_path).get("mesh.vert", "mesh.frag")


def test_link_error_is_one_line(gl, tmp_path):
    write(tmp_path, mesh__vert=VERTEX)
    write(
        tmp_path,
        mesh__frag="out vec4 c;\nvec4 nowhere();\nvoid main() { c = nowhere(); }\n",
    )
    with pytest.raises(FexelError) as error:
        ProgramCache(gl, tmp_path).get("mesh.vert", "mesh.frag")
    assert "nowhere" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '#include "missing.glsl"\n',
            r"main\.frag:1: cannot read shader missing\.glsl",
        ),
        (
            'float a;\n#include "../secret.glsl"\n',
            r"main\.frag:2: '\.\./secret\.glsl' is not the name",
        ),
        ("#include <a.glsl>\n", r"main\.frag:1: malformed #include"),
        ('#ifdef A\n#include "main.frag"\n#endif\n', r"main\.frag:2: .*inside #if"),
    ],
)
def test_bad_include_is_named_by_file_and_line(tmp_path, text, message):
    write(tmp_path, main__frag=text)
    with pytest.raises(FexelError, match=message):
        load_shader("main.frag", folder=tmp_path)


@pytest.mark.parametrize(
    "defines",
    [
        {"NAME": "a; } void main() { discard"},
        {"NAME": "/World/Logo"},
        {"NAME": "line\n#define X 1"},
        {"NAME": ""},
        {"NAME": float("nan")},
        {"NAME": float("inf")},
        {"NAME": None},
        {"NA ME": 1},
        {"1NAME": 1},
        {"NAME\n": 1},
        {"gl_Position": 1},
    ],
)
def test_define_that_is_no_identifier_or_finite_number_is_refused(tmp_path, defines):
    write(tmp_path, main__frag="void main() {}\n")
    with pytest.raises(FexelError, match="define"):
        load_shader("main.frag", defines, folder=tmp_path)


def test_values_of_defines_reach_the_shader_exactly(gl, tmp_path):
    import numpy as np

    write(
        tmp_path,
        quad__vert="void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }",
    )
    write(tmp_path, f__glsl="float f(float x) { return 2.0 * x; }\n")
    write(
        tmp_path,
        main__frag="out vec4 c;\nvoid main() { c = vec4(A, B, C, FUNCTION(A)); }\n",
    )
    defines = {"A": 0.1, "B": 3, "C": True, "FUNCTION": "f"}
    cache = ProgramCache(gl, tmp_path)
    program = cache.get("quad.vert", "main.frag", defines, includes=("f.glsl", "f.glsl"))
    frame = gl.framebuffer([gl.texture((1, 1), 4, dtype="f4")])
    frame.use()
    gl.vertex_array(program, []).render(vertices=3)
    np.testing.assert_allclose(
        np.frombuffer(frame.read(components=4, dtype="f4"), "f4"),
        [0.1, 3, 1, 0.2],
        rtol=1e-7,
    )
    assert cache.get("quad.vert", "main.frag", defines, includes=("f.glsl",)) is program and len(cache) == 1


def test_every_shipped_shader_file_resolves():
    from fexel._resources import shaders_dir

    files = sorted(path.name for path in shaders_dir().iterdir() if path.suffix in (".glsl", ".vert", ".frag"))
    for name in files:
        assert load_shader(name).files[1] == name
