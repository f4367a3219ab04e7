"""Lists the benchmarks of a folder: each script's name and the first line of its docstring."""

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
    scripts = [path for path in sorted(folder.glob("*.py")) if not path.name.startswith("_")]
    width = max((len(path.stem) for path in scripts), default=0)
    for path in scripts:
        print(f"{path.stem:{width}}  {first_line(path)}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
