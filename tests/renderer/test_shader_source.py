from __future__ import annotations

from importlib import resources
from pathlib import Path

import pytest

from octobrick.renderer import ShaderError
from octobrick.renderer.shader_source import VERSION_LINE, numbered, shader_source


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "main.glsl").write_text('#include "part.glsl"\nint n = ${N};\n')
    (tmp_path / "part.glsl").write_text("bool flag = bool(${FLAG});\n")
    (tmp_path / "loop.glsl").write_text('#include "back.glsl"\n')
    (tmp_path / "back.glsl").write_text('#include "loop.glsl"\n')
    (tmp_path / "gone.glsl").write_text('#include "missing.glsl"\n')
    return tmp_path


def test_includes_and_names_are_replaced(folder: Path) -> None:
    text = shader_source("main.glsl", {"N": 3, "FLAG": True}, folder=folder)
    assert text == VERSION_LINE + "bool flag = bool(1);\nint n = 3;\n"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"N": 3}, r"no value for \['FLAG'\], no use for \[\]"),
        ({"N": 3, "FLAG": 1, "M": 2}, r"no value for \[\], no use for \['M'\]"),
        ({"n": 3, "FLAG": 1}, r"no value for \['N'\], no use for \['n'\]"),
    ],
)
def test_names_and_values_that_do_not_match_are_refused(
    folder: Path, values: dict[str, int], message: str
) -> None:
    with pytest.raises(ShaderError, match=message):
        shader_source("main.glsl", values, folder=folder)


def test_missing_files_are_named_with_who_wants_them(folder: Path) -> None:
    with pytest.raises(ShaderError, match=r"no shader file missing.glsl, included by gone.glsl"):
        shader_source("gone.glsl", {}, folder=folder)
    with pytest.raises(ShaderError, match=r"no shader file nowhere.glsl"):
        shader_source("nowhere.glsl", {}, folder=folder)


def test_a_file_that_includes_itself_is_refused(folder: Path) -> None:
    with pytest.raises(ShaderError, match="includes itself"):
        shader_source("loop.glsl", {}, folder=folder)


def test_lines_are_numbered_as_compilers_do() -> None:
    assert numbered("a\nb") == "   1  a\n   2  b"


def test_no_shader_has_an_include_that_is_not_expanded() -> None:
    """The include pattern wants a whole line; anything else would reach the driver."""
    for file in (resources.files("octobrick.renderer") / "shaders").iterdir():
        lines = file.read_text("utf-8").splitlines()
        assert all('#include "' in line for line in lines if "#include" in line)
        assert all(line.startswith("#include") for line in lines if "#include" in line)
