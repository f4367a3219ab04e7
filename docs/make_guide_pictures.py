"""Runs the Python of guide-rendering.md and keeps the pictures that the page shows.

python docs/make_guide_pictures.py      writes docs/images/guide-*.webp
"""

from __future__ import annotations

import contextlib
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from octobrick.store import ingest

DOCS = Path(__file__).parent
PAGE = DOCS / "guide-rendering.md"
SOURCE = DOCS.parent / "data" / "ct_vhf_head.mhd"


def code_of(page: Path) -> str:
    """All Python of a page, in order, at the lines where it stands."""
    text = page.read_text(encoding="utf-8")
    lines = [""] * (text.count("\n") + 1)
    for block in re.finditer(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        first = text.count("\n", 0, block.start(1))
        code = block[1].splitlines()
        lines[first : first + len(code)] = code
    return "\n".join(lines)


def pictures_of(page: Path) -> set[str]:
    """Names of the pictures that a page shows and its code makes."""
    return set(re.findall(r"images/(guide-[\w-]+\.\w+)", page.read_text(encoding="utf-8")))


def run_page(folder: Path, names: dict[str, Any] | None = None) -> None:
    """Run the page in a folder where `head.zarr` is, and leave there what it writes."""
    program = compile(code_of(PAGE), str(PAGE), "exec")
    with contextlib.chdir(folder):
        exec(program, {"__name__": "__guide__"} | (names or {}))  # noqa: S102  it is our own page


def main() -> int:
    """Make all pictures anew."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ingest(SOURCE, folder / "head.zarr")
        run_page(folder)
        total_nbytes = 0
        for picture in sorted(pictures_of(PAGE)):
            shutil.copyfile(folder / picture, DOCS / "images" / picture)
            total_nbytes += (folder / picture).stat().st_size
            sys.stdout.write(f"{picture}: {(folder / picture).stat().st_size} bytes\n")
        sys.stdout.write(f"{total_nbytes} bytes in all\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
