"""All measurements of the codec in one run: speed, rate and distortion, access, gradients, seams.

    script/bench codec [--parts zerobit,deblock] [--quick] [--data ../shared/data] [--json FILE]

Prints the table of each part as soon as it is measured, and writes all figures, with the machine,
to bench/out/codec.json. A part is a module of this folder with `run(data, quick)`, which returns
figures that JSON takes, and `table(figures)`; most also run by themselves. One that is missing or
fails is named, and the others are measured nevertheless; the status is then 1.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import time
import traceback
from pathlib import Path
from typing import Any

import _measure

PARTS = {
    "s3dc_speed": "s3dc_speed",
    "s3dc_rate": "s3dc_rate",
    "sampling": "s3dc_sampling",
    "zerobit": "zerobit",
    "gradients": "gradient_speed",
    "gradient_pyramid": "gradient_pyramid",
    "deblock": "deblock",
}
"""Name of a part: its module. A new part is a line here."""


def measure(name: str, data: Path, quick: bool) -> dict[str, Any]:
    """The figures of a part, whose table is printed; or, loudly, why there are none."""
    module_name = PARTS[name]
    if importlib.util.find_spec(module_name) is None:
        return failed(name, f"there is no bench/{module_name}.py")
    start = time.perf_counter()
    try:
        part = importlib.import_module(module_name)
        if not hasattr(part, "run") or not hasattr(part, "table"):
            return failed(
                name, f"bench/{module_name}.py has no run(data, quick) and table(figures)"
            )
        figures: dict[str, Any] = part.run(data, quick)
        print(part.table(figures), flush=True)
    except Exception as error:  # the parts after it are measured nevertheless
        traceback.print_exc()
        return failed(name, f"{type(error).__name__}: {error}")
    return {"seconds": round(time.perf_counter() - start, 1), **figures}


def failed(name: str, why: str) -> dict[str, Any]:
    print(f"!! {name} was not measured: {why}", file=sys.stderr, flush=True)
    return {"failed": why}


def chosen(parts: str) -> list[str]:
    names = parts.split(",")
    unknown = sorted(set(names) - set(PARTS))
    if unknown:
        sys.exit(f"no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    return names


def main() -> None:
    parser = _measure.parser(__doc__)
    parser.set_defaults(json=_measure.OUT / "codec.json")
    parser.add_argument(
        "--parts", type=chosen, default=list(PARTS), help=f"some of {','.join(PARTS)}"
    )
    options = parser.parse_args()
    report: dict[str, Any] = {"machine": _measure.machine(), "quick": options.quick, "parts": {}}
    print("  ".join(f"{name} {value}" for name, value in report["machine"].items()))
    for name in options.parts:
        print(f"\n== {name}", flush=True)
        report["parts"][name] = measure(name, options.data, options.quick)
        _measure.write_json(options.json, report)  # after each: a run that is cut short has some
    print(f"\nwritten to {options.json}")
    missing = [name for name, figures in report["parts"].items() if "failed" in figures]
    if missing:
        sys.exit(f"!! not measured: {', '.join(missing)}")


if __name__ == "__main__":
    main()
