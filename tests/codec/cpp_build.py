"""Builds of the C++ library and of the programs in tests/cpp that use it, for tests to run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Those of .venv: a machine need not have its own.
TOOLS = Path(sys.executable).parent
# Minutes of processor time, which others may be using; only a compiler that hangs takes so long.
BUILD_SECONDS = 3600
CONFIGURE = (TOOLS / "cmake", "-G", "Ninja", f"-DCMAKE_MAKE_PROGRAM={TOOLS / 'ninja'}")


def run(*command: str | Path, seconds: float = 600) -> str:
    """What a command says, which must succeed."""
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=seconds
    )
    assert done.returncode == 0, (
        f"{command} ended with {done.returncode}\n{done.stdout}{done.stderr}"
    )
    return done.stdout


def configure_and_build(source: Path, build: Path, *options: str) -> None:
    """Compiles what has changed since the last time."""
    run(*CONFIGURE, "-S", source, "-B", build, *options)
    run(TOOLS / "cmake", "--build", build, seconds=BUILD_SECONDS)


def build_library(name: str, *options: str) -> Path:
    """The folder, kept between runs, of a build without Python."""
    build = ROOT / "build" / name
    configure_and_build(ROOT, build, "-DOCTOBRICK_PYTHON=OFF", *options)
    return build


def build_beside_python() -> Path:
    """The build that the Python module came from, whose library is made up to date.

    Where octobrick was installed without a build of its own here, one without Python.
    """
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    for cache in sorted(ROOT.glob(f"build/{tag}-*/CMakeCache.txt")):
        run(TOOLS / "cmake", "--build", cache.parent, "--target", "octobrick_codec",
            seconds=BUILD_SECONDS)  # fmt: skip
        return cache.parent
    return build_library("cpp")


def install_library(build: Path, prefix: Path) -> None:
    """What docs/cpp.md says to do."""
    run(TOOLS / "cmake", "--install", build, "--component", "cpp", "--prefix", prefix)


def build_programs(prefix: Path, build: Path, *options: str) -> None:
    """The programs of tests/cpp, against the library that was installed to `prefix`."""
    configure_and_build(ROOT / "tests/cpp", build, f"-DCMAKE_PREFIX_PATH={prefix}", *options)
