"""The C++ library, installed and used as docs/cpp.md says."""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
from pathlib import Path

import pytest

from .cpp_build import CONFIGURE, ROOT, build_beside_python, build_programs, install_library, run

PAGE = (ROOT / "docs/cpp.md").read_text()


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("prefix")
    install_library(build_beside_python(), folder)
    return folder


@pytest.fixture(scope="module")
def programs(prefix: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("programs")
    build_programs(prefix, folder)
    return folder


def block_of(language: str, containing: str) -> str:
    """The block of docs/cpp.md in that language that contains a text."""
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    (found,) = (block for block in blocks if containing in block)
    return str(found)


def test_example_says_what_its_page_says(programs: Path) -> None:
    assert run(programs / "example") == block_of("text", "s3dc:")


def test_page_shows_the_example_as_it_is() -> None:
    assert block_of("cpp", "through_s3dc") in (ROOT / "tests/cpp/example.cpp").read_text()


def test_page_builds_a_project_of_its_own(prefix: Path, tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(block_of("cmake", "find_package"))
    (tmp_path / "example.cpp").write_text((ROOT / "tests/cpp/example.cpp").read_text())
    run(*CONFIGURE, "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}")


def test_golden_vectors_are_read_and_written_by_every_set_of_instructions(programs: Path) -> None:
    said = run(programs / "golden", ROOT / "tests/golden")
    for family in ("s3dc", "gradients", "zerobit"):
        codes = len(list((ROOT / "tests/golden" / family).glob("*.code")))
        assert f"{family}: {codes} codes\n" in said


def test_generated_volumes_are_the_same_by_every_set_of_instructions(programs: Path) -> None:
    assert run(programs / "instructions").startswith("100 rounds of all types and bits: the same")


def test_golden_checker_finds_a_changed_byte(programs: Path, tmp_path: Path) -> None:
    (tmp_path / "s3dc").mkdir()
    source = ROOT / "tests/golden/s3dc"
    name = "uint8-5x6x21-blocks4x4x8-4bit-structure"
    for extension in ("code", "voxels", "decoded"):
        content = bytearray((source / f"{name}.{extension}").read_bytes())
        content[-1] ^= extension == "decoded"
        (tmp_path / "s3dc" / f"{name}.{extension}").write_bytes(content)
    done = subprocess.run([programs / "golden", tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert f"not so: decoded == expected  {name}" in done.stderr


def test_every_installed_header_stands_alone(prefix: Path, tmp_path: Path) -> None:
    include = prefix / "include"
    headers = sorted(path.relative_to(include) for path in include.rglob("*.h"))
    assert Path("octobrick/codec.h") in headers
    for header in headers:
        source = tmp_path / "alone.cpp"
        source.write_text(f"#include <{header}>\n")
        compiler = os.environ.get("CXX", "c++")
        run(compiler, "-std=c++20", "-Wall", "-Werror", "-fsyntax-only", f"-I{include}", source)


def test_umbrella_header_names_every_header() -> None:
    include = ROOT / "codec/include"
    named = re.findall(r'#include "(.*)"', (include / "octobrick/codec.h").read_text())
    there = [str(path.relative_to(include)) for path in (include / "octobrick/codec").iterdir()]
    assert named == sorted(there)


def test_other_minor_version_is_refused(prefix: Path, tmp_path: Path) -> None:
    version = importlib.metadata.version("octobrick")
    major, minor = (int(part) for part in version.split(".")[:2])
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.20)\nproject(other LANGUAGES CXX)\n"
        f"find_package(octobrick_codec {major}.{minor + 1} REQUIRED)\n"
    )
    command = [*CONFIGURE, "-S", tmp_path, "-B", tmp_path / "build"]
    command.append(f"-DCMAKE_PREFIX_PATH={prefix}")
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0
    assert f"octobrick_codec-config.cmake, version: {version}" in done.stderr


def test_python_package_holds_nothing_of_the_cpp_library() -> None:
    files = importlib.metadata.files("octobrick")
    assert files
    names = [str(file) for file in files]
    assert any("_native" in name for name in names)
    assert not [name for name in names if name.endswith((".a", ".h", ".cmake"))]
