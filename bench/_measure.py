"""What measurements share: the machine, medians, tables, a C++ program, a part's command line."""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import statistics
import subprocess
import sysconfig
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared/data"
OUT = ROOT / "bench/out"

Run = Callable[[Path, bool], dict[str, Any]]
"""A part's measurement: of the volumes of a folder; quick or whole."""

Table = Callable[[dict[str, Any]], str]
"""A part's figures as text."""


def machine() -> dict[str, Any]:
    """What ran it, and when."""
    compiler = [os.environ.get("CXX", "c++"), "--version"]
    return {
        "cpu": _cpu(),
        "cores": len(os.sched_getaffinity(0)),
        "load_average": round(os.getloadavg()[0], 2),
        "compiler": subprocess.run(
            compiler, check=True, capture_output=True, text=True
        ).stdout.partition("\n")[0],
        "python": platform.python_version(),
        "system": platform.platform(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _cpu() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine()


def alternating(
    calls: Mapping[str, Callable[[], object]],
    rounds: int,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, float]:
    """The median seconds of each call; they take turns, so that a drifting machine is fair to all.

    A first call of each, which makes tables and pages, does not count.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(rounds):
        for name, call in calls.items():
            start = clock()
            call()
            seconds[name].append(clock() - start)
    return {name: statistics.median(took) for name, took in seconds.items()}


def processor_seconds() -> float:
    """Processor time of this process and of children that ended: other work does not count."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def layout(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Lines of aligned columns: the first to the left, the others to the right."""
    lines = [list(head), *map(list, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if k else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    )


@contextmanager
def program(name: str) -> Iterator[Path]:
    """A program of bench/, built by cmake from this checkout for as long as it is needed."""
    scripts = sysconfig.get_path("scripts")
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"}
    with TemporaryDirectory() as folder:
        for command in (
            ["-S", str(ROOT), "-B", folder, "-DOCTOBRICK_PYTHON=OFF", "-DOCTOBRICK_BENCH=ON"],
            ["--build", folder, "--target", name],
        ):
            subprocess.run(
                ["cmake", *command], check=True, stdout=subprocess.DEVNULL, env=environment
            )
        yield Path(folder) / "codec" / name


def parser(doc: str | None) -> argparse.ArgumentParser:
    """The options that every part has."""
    made = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument("--data", type=Path, default=DATA, help="the folder of the volumes")
    made.add_argument("--quick", action="store_true", help="less of everything, to try it out")
    made.add_argument("--json", type=Path, metavar="FILE", help="write the figures there")
    return made


def write_json(path: Path, value: object) -> None:
    """Figures for programs; makes the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value, indent=2) + "\n", encoding="utf-8")


def report(options: argparse.Namespace, figures: dict[str, Any], table: Table) -> None:
    """Prints the figures of one part, and writes them where its options say so."""
    print(table(figures))
    if options.json:
        write_json(options.json, {"machine": machine(), **figures})


def main(doc: str | None, run: Run, table: Table) -> None:
    """One part by itself, from its command line."""
    options = parser(doc).parse_args()
    report(options, run(options.data, options.quick), table)
