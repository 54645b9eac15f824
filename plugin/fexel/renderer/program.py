"""GLSL programs: files of `shaders/` with nested includes, true line numbers and checked defines, cached by content.

A source starts with the ``#version`` line and the defines; then come the files of `includes` (a texture kind's shader,
for example) and the shader itself. ``#include "file.glsl"`` is resolved here: nested, each file once, and only outside
``#if`` blocks. ``#line LINE SOURCE`` around every file lets a compile error be told by file and line. Nothing that a
stage contains can enter a source: names of defines and their values are identifiers or numbers, file names are those
of `shaders/`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from fexel._resources import shaders_dir
from fexel.errors import FexelError

if TYPE_CHECKING:
    import moderngl

__all__ = ["Define", "ProgramCache", "ShaderSource", "compile_program", "load_shader"]

Define = bool | int | float | str

_VERSION = "#version 330 core"
_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_FILE_NAME = re.compile(r"[a-z][a-z0-9_]*\.(glsl|vert|frag)\Z")
_DIRECTIVE = re.compile(r"\s*#\s*(\w+)\s*(.*?)\s*\Z")
_INCLUDE = re.compile(r'"([^"]*)"\s*(//.*)?\Z')
# Mesa "0:12(5): error: ...", NVIDIA "0(12) : error C0000: ...", others "ERROR: 0:12: ...".
_COMPILER_MESSAGE = re.compile(r"(?:ERROR:\s*)?\d+(?::(\d+)(?:\(\d+\))?|\((\d+)\))\s*:\s*(.+)")
# Mesa's parser forgets the source number ("0:12" whatever #line said), so the line number carries it as well.
_LINES_PER_SOURCE = 100_000


@dataclass(frozen=True)
class ShaderSource:
    """A resolved source: `text` for the compiler; `files[i]` is the name of source string i in its messages."""

    text: str
    files: tuple[str, ...]

    def explain(self, log: str) -> str:
        """One line from a compiler's log: file, line and the first error, and how many more there are."""
        messages = [match for match in map(_COMPILER_MESSAGE.match, log.splitlines()) if match]
        errors = [match for match in messages if "error" in match[0].lower()] or messages
        if not errors:
            return " ".join(log.split()) or "unknown error"
        first = errors[0]
        source, line = divmod(int(first[1] or first[2]), _LINES_PER_SOURCE)
        name = self.files[min(source, len(self.files) - 1)]
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        return f"{name}:{line}: {first[3].strip()}{more}"


def load_shader(
    name: str,
    defines: Mapping[str, Define] | None = None,
    includes: Iterable[str] = (),
    folder: Path | None = None,
) -> ShaderSource:
    """Read a shader and everything it includes.

    Parameters
    ----------
    name : str
        File in `folder`.
    defines : mapping of str to bool, int, float or str, optional
        Written before everything else. Strings must be GLSL identifiers (a function's name); booleans become 1 or 0.
    includes : iterable of str, optional
        Files to include before the shader.
    folder : Path, optional
        Where the files are; default `shaders/`.

    Raises
    ------
    FexelError
        Missing file, malformed or conditional include, or a define that is neither identifier nor finite number.
    """
    reader = _Reader(folder or shaders_dir())
    lines = [_VERSION, *_define_lines(defines or {})]
    for file in dict.fromkeys(includes):
        lines += reader.read(file, "the list of includes")
    lines += reader.read(name, "the program")
    return ShaderSource("\n".join(lines) + "\n", ("<defines>", *reader.files))


class _Reader:
    """Resolves includes; remembers which files were read, in order."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.files: list[str] = []

    def read(self, name: str, where: str) -> list[str]:
        if name in self.files:
            return []
        source = len(self.files) + 1
        self.files.append(name)
        lines = [_line(1, source)]
        depth = 0
        for number, line in enumerate(self._text(name, where).splitlines(), start=1):
            directive = _DIRECTIVE.match(line)
            keyword = directive[1] if directive else ""
            depth += (keyword in ("if", "ifdef", "ifndef")) - (keyword == "endif")
            if directive and keyword == "include":
                file = self._included(directive[2], f"{name}:{number}", depth)
                lines += [
                    *self.read(file, f"{name}:{number}"),
                    _line(number + 1, source),
                ]
            else:
                lines.append(line)
        return lines

    def _included(self, argument: str, where: str, depth: int) -> str:
        match = _INCLUDE.match(argument)
        if not match:
            raise FexelError(f'{where}: malformed #include {argument}, expected #include "file.glsl"')
        if depth:
            raise FexelError(f"{where}: #include of {match[1]} inside #if; a file is read once, so put it outside")
        return match[1]

    def _text(self, name: str, where: str) -> str:
        if not _FILE_NAME.match(name):
            raise FexelError(f"{where}: {name!r} is not the name of a shader file")
        try:
            return (self._folder / name).read_text(encoding="utf-8")
        except OSError as error:
            raise FexelError(f"{where}: cannot read shader {name}: {error.strerror}") from None


def _line(number: int, source: int) -> str:
    return f"#line {source * _LINES_PER_SOURCE + number} {source}"


def _define_lines(defines: Mapping[str, Define]) -> list[str]:
    return [f"#define {_checked_name(name)} {_literal(name, value)}" for name, value in sorted(defines.items())]


def _checked_name(name: str) -> str:
    if not _IDENTIFIER.match(name) or name.startswith("gl_") or "__" in name:
        raise FexelError(f"{name!r} is not a name for a shader define")
    return name


def _literal(name: str, value: Define) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int):
        return str(int(value))
    if isinstance(value, float) and math.isfinite(value):
        return repr(float(value))
    if isinstance(value, str) and _IDENTIFIER.match(value) and "__" not in value:
        return value
    raise FexelError(f"shader define {name}: {value!r} is neither an identifier nor a finite number")


def compile_program(gl: moderngl.Context, vertex: ShaderSource, fragment: ShaderSource) -> moderngl.Program:
    """Compile and link.

    Raises
    ------
    FexelError
        ``file:line: message`` of the first compile error, or what the linker says.
    """
    import moderngl

    try:
        return gl.program(vertex_shader=vertex.text, fragment_shader=fragment.text)
    except moderngl.Error as error:
        log = str(error)
        source = vertex if "vertex_shader" in log else fragment
        raise FexelError(f"shader {source.explain(log)}") from None


class ProgramCache:
    """Programs of one context by shader files, includes and defines; each is compiled once.

    Examples
    --------
    >>> cache = ProgramCache(gl)                                            # doctest: +SKIP
    >>> program = cache.get("mesh.vert", "mesh.frag", {"HAS_LIGHTS": True})  # doctest: +SKIP
    """

    def __init__(self, gl: moderngl.Context, folder: Path | None = None) -> None:
        self._gl = gl
        self._folder = folder
        self._programs: dict[tuple, moderngl.Program] = {}

    def __len__(self) -> int:
        return len(self._programs)

    def get(
        self,
        vertex: str,
        fragment: str,
        defines: Mapping[str, Define] | None = None,
        includes: Iterable[str] = (),
    ) -> moderngl.Program:
        """The program for these files and defines; `includes` go before the fragment shader."""
        defines = dict(defines or {})
        includes = tuple(dict.fromkeys(includes))
        key = (
            vertex,
            fragment,
            includes,
            tuple(sorted((name, repr(value)) for name, value in defines.items())),
        )
        if key not in self._programs:
            self._programs[key] = compile_program(
                self._gl,
                load_shader(vertex, defines, (), self._folder),
                load_shader(fragment, defines, includes, self._folder),
            )
        return self._programs[key]

    def release(self) -> None:
        """Free all programs."""
        for program in self._programs.values():
            program.release()
        self._programs.clear()
