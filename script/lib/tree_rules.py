"""The rules that every file of the tree keeps, as pure functions of its path and bytes.

    python script/lib/tree_rules.py ROOT                     what breaks a rule; status 1 if any
    python script/lib/tree_rules.py ROOT --list PATTERN...   NUL-separated paths, e.g. '*.cpp'

Standard library only, so that it runs anywhere. ``script/check`` calls it, and
``tests/house/test_tree_rules.py`` proves that each rule can fail.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

# 400 is the aim (CONTRIBUTING.md); from here on a file holds more than one noun.
MAX_SOURCE_LINES = 500
SOURCE_SUFFIXES = {".c", ".cpp", ".glsl", ".h", ".hpp", ".py", ".sh", ".ts", ".tsx"}

# A path of one person's machine works nowhere else. (Written so that it does not match itself.)
MACHINE_PATH = re.compile(rb"(?<![\w.~-])/(?:home|root|Users|work)/[\w.-]+")

# Made by tools or by our own commands; only asked where there is no git to ask (a tarball).
OUTPUT_FOLDERS = {"build", "demo", "dist", "out", "__pycache__"}


@dataclass(frozen=True)
class File:
    """One file of the tree; the path is relative to its root."""

    path: PurePosixPath
    content: bytes


def too_long(file: File) -> str | None:
    """A source file holds one noun, and so stays short."""
    lines = file.content.count(b"\n")
    if file.path.suffix in SOURCE_SUFFIXES and lines > MAX_SOURCE_LINES:
        return f"{lines} lines, more than {MAX_SOURCE_LINES}: split it, one noun per file"
    return None


def closes_namespace(file: File) -> str | None:
    """Five folders are one namespace (PEP 420) only while none has ``octobrick/__init__.py``."""
    if file.path.parts[-2:] == ("octobrick", "__init__.py"):
        return "makes octobrick a regular package and hides the other components: remove it"
    return None


def names_a_machine(file: File) -> str | None:
    """Nothing in the tree depends on, or tells of, the machine that it was written on."""
    found = None if b"\0" in file.content else MACHINE_PATH.search(file.content)
    if found is None:
        return None
    line = file.content.count(b"\n", 0, found.start()) + 1
    return f"line {line} names {found[0].decode()}, a path of one machine: make it relative"


RULES = (too_long, closes_namespace, names_a_machine)


def tree_files(root: Path) -> list[PurePosixPath]:
    """Every file that belongs to the tree: tracked by git, or new and not ignored."""
    if not (root / ".git").exists():
        return sorted(_walk(root, PurePosixPath()))
    # The owner of a checkout in a container is often another user; we only list names.
    command = ["git", "-c", f"safe.directory={root}", "-C", str(root), "ls-files", "-z"]
    command += ["--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, check=True, capture_output=True).stdout
    paths = {PurePosixPath(name) for name in listed.decode().split("\0") if name}
    return sorted(path for path in paths if (root / path).is_file())


def _walk(root: Path, folder: PurePosixPath) -> Iterator[PurePosixPath]:
    for entry in (root / folder).iterdir():
        path = folder / entry.name
        if entry.is_dir() and not entry.is_symlink():
            hidden = entry.name.startswith(".") and entry.name != ".ci"
            if not hidden and entry.name not in OUTPUT_FOLDERS and entry.suffix != ".zarr":
                yield from _walk(root, path)
        elif entry.is_file():
            yield path


def broken_rules(root: Path) -> Iterator[str]:
    """One line for each rule that a file of the tree breaks."""
    for path in tree_files(root):
        file = File(path, (root / path).read_bytes())
        complaints = (rule(file) for rule in RULES)
        yield from (f"{path}: {complaint}" for complaint in complaints if complaint is not None)


def main(arguments: list[str]) -> int:
    """Run as a command: see the top of this file."""
    match arguments:
        case [root]:
            complaints = list(broken_rules(Path(root).resolve()))
            print("".join(f"{line}\n" for line in complaints), end="")
            return 1 if complaints else 0
        case [root, "--list", *patterns]:
            for path in tree_files(Path(root).resolve()):
                if any(path.match(pattern) for pattern in patterns):
                    print(path, end="\0")
            return 0
        case _:
            print(__doc__, file=sys.stderr)
            return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
