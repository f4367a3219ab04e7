"""Every fuzz target runs for a few seconds with the address and undefined-behaviour sanitisers.

The targets have the driver that needs no clang: codec/fuzz/standalone_main.cpp. Longer runs, and
those of libFuzzer, are by hand: CONTRIBUTING.md.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from .cpp_build import ROOT, build_library

SECONDS = 8
COMPILER = os.environ.get("CXX", "c++")
FUZZ = ROOT / "codec/fuzz"
LISTED = re.search(r"^set\(targets\n(.*?)\)", (FUZZ / "CMakeLists.txt").read_text(), re.M | re.S)
assert LISTED is not None
TARGETS = LISTED.group(1).split()
# Leaks are looked for with ptrace, which containers may forbid; by hand they are found.
ENVIRONMENT = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}


def compile_sanitised(program: Path, *sources: Path) -> subprocess.CompletedProcess[str]:
    command: list[str | Path] = [COMPILER, "-std=c++20", "-O1", "-fsanitize=address,undefined"]
    command += ["-fno-sanitize-recover=all", f"-I{FUZZ}", f"-I{ROOT / 'codec/include'}"]
    return subprocess.run([*command, *sources, "-o", program], capture_output=True, text=True)


@pytest.fixture(scope="module", autouse=True)
def _sanitisers(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("sanitisers")
    (folder / "empty.cpp").write_text("int main() {}\n")
    built = compile_sanitised(folder / "empty", folder / "empty.cpp")
    if built.returncode != 0:
        pytest.skip(f"NOTHING WAS FUZZED: {COMPILER} has no sanitisers: {built.stderr.strip()}")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """The status and output of every target; they run side by side."""
    programs = build_library("fuzz", "-DOCTOBRICK_FUZZ=ON", "-DOCTOBRICK_FUZZ_STANDALONE=ON")
    started = {}
    for target in TARGETS:
        folder = tmp_path_factory.mktemp(target)  # where crash-input would be written
        command = [programs / f"codec/fuzz/{target}_fuzzer", f"-max_total_time={SECONDS}"]
        golden = ROOT / "tests/golden" / target
        started[target] = subprocess.Popen(
            [*command, golden] if golden.is_dir() else command,
            cwd=folder,
            env=ENVIRONMENT,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
    said = {target: process.communicate()[0] for target, process in started.items()}
    return {target: (started[target].returncode, said[target]) for target in TARGETS}


@pytest.mark.parametrize("target", TARGETS)
def test_no_input_breaks_a_target(runs: dict[str, tuple[int, str]], target: str) -> None:
    status, said = runs[target]
    assert status == 0, said
    counted = re.fullmatch(r"(\d+) runs, seed 1, corpus of (\d+)\n", said)
    assert counted is not None, said
    assert int(counted[1]) > 0
    golden = ROOT / "tests/golden" / target
    assert int(counted[2]) == (len(list(golden.iterdir())) if golden.is_dir() else 0)


def test_every_target_has_a_file_and_is_listed() -> None:
    files = {path.name.removesuffix("_fuzzer.cpp") for path in FUZZ.glob("*_fuzzer.cpp")}
    assert files == set(TARGETS)


# A target with three faults: behind its input, without end, and a promise that is not kept.
FAULTY = """
#include "fuzz.h"
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    if (size > 0 && data[0] == 1) return data[size];
    volatile bool forever = size > 0 && data[0] == 2;
    while (forever) {}
    REQUIRE(size == 0 || data[0] != 3);
    return 0;
}
"""


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("faulty")
    (folder / "faulty.cpp").write_text(FAULTY)
    built = compile_sanitised(
        folder / "faulty", folder / "faulty.cpp", FUZZ / "standalone_main.cpp"
    )
    assert built.returncode == 0, built.stderr
    return folder / "faulty"


def fuzz(program: Path, folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [program, "-timeout=1", *arguments]
    return subprocess.run(command, cwd=folder, env=ENVIRONMENT, capture_output=True, text=True)


@pytest.mark.parametrize(
    ("first", "said"),
    [(1, "heap-buffer-overflow"), (2, "takes longer than the timeout"), (3, "not so: size == 0")],
)
def test_driver_ends_with_the_input_that_fails(
    faulty: Path, tmp_path: Path, first: int, said: str
) -> None:
    (tmp_path / "input").write_bytes(bytes([first, 9, 9]))
    done = fuzz(faulty, tmp_path, "input")
    assert done.returncode != 0
    assert said in done.stderr
    assert (tmp_path / "crash-input").read_bytes() == bytes([first, 9, 9])


def test_driver_finds_a_fault_by_itself_and_again_from_what_it_saved(
    faulty: Path, tmp_path: Path
) -> None:
    found = fuzz(faulty, tmp_path, "-runs=100000")
    assert found.returncode != 0
    again = fuzz(faulty, tmp_path, "crash-input")
    assert again.returncode == found.returncode


def test_same_seed_makes_the_same_inputs(faulty: Path, tmp_path: Path) -> None:
    saved = []
    for seed in ("1", "1", "2"):
        assert fuzz(faulty, tmp_path, f"-seed={seed}", "-runs=100000").returncode != 0
        saved.append((tmp_path / "crash-input").read_bytes())
    assert saved[0] == saved[1] != saved[2]
