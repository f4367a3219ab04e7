"""Lists the benchmarks of a folder and of those in it: name, and first line of the docstring."""

from __future__ import annotations

import ast
import sys
from pathlib import Path


def first_line(script: Path) -> str:
    """What a script says of itself, without running it."""
    docstring = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0]


def main(folder: Path) -> None:
    """Print one line for each script; modules that begin with ``_`` are shared, not run."""
    found = sorted(folder.glob("*.py")) + sorted(folder.glob("*/*.py"))
    scripts = {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for path in found
        if not path.name.startswith("_")
    }
    width = max(map(len, scripts), default=0)
    for name, path in scripts.items():
        print(f"{name:{width}}  {first_line(path)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
