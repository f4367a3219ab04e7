"""The C++ library on 64-bit ARM: compiled where there is a cross compiler, run where there is qemu.

On Debian: apt-get install g++-aarch64-linux-gnu qemu-user
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from .cpp_build import ROOT, build_library, build_programs, install_library, run

COMPILER = "aarch64-linux-gnu-g++"
CROSS = (
    "-DCMAKE_SYSTEM_NAME=Linux",
    "-DCMAKE_SYSTEM_PROCESSOR=aarch64",
    f"-DCMAKE_CXX_COMPILER={COMPILER}",
)

if shutil.which(COMPILER) is None:
    pytest.skip(f"there is no {COMPILER}", allow_module_level=True)


@pytest.fixture(scope="module")
def library() -> Path:
    return build_library("aarch64", *CROSS)


# One on whole vectors, such as "umull v1.8h, v2.8b, v3.8b".
NEON = re.compile(r"\tv\d+\.(?:16b|8h|4s|2d), v")


@pytest.mark.parametrize(
    "source", ["bezier", "error_stats", "gradient_code", "reduce", "s3dc_decode", "s3dc_encode"]
)
def test_every_body_that_wants_vectors_is_compiled_to_neon(library: Path, source: str) -> None:
    binary = library / f"codec/CMakeFiles/octobrick_codec.dir/src/{source}.cpp.o"
    listing = run("aarch64-linux-gnu-objdump", "-dC", "--no-show-raw-insn", binary)
    functions = re.split(r"^[0-9a-f]+ <(.*)>:$", listing, flags=re.MULTILINE)[1:]
    bodies = {
        name: len(NEON.findall(code))
        for name, code in zip(functions[::2], functions[1::2], strict=True)
        if "::baseline(" in name  # of `Compiled` in simd.h
    }
    assert bodies
    # The least, a loop of mean2, has 16; scalar code has none or a few that set things to zero.
    assert not {name: count for name, count in bodies.items() if count < 12}


@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="there is no qemu-aarch64")
def test_golden_vectors_and_example_are_the_same(library: Path, tmp_path: Path) -> None:
    install_library(library, tmp_path / "prefix")
    programs = tmp_path / "programs"
    build_programs(tmp_path / "prefix", programs, *CROSS, "-DCMAKE_EXE_LINKER_FLAGS=-static")
    said = run("qemu-aarch64", programs / "golden", ROOT / "tests/golden")
    assert said.count(" codes\n") == 3
    assert run("qemu-aarch64", programs / "example") in (ROOT / "docs/cpp.md").read_text()
