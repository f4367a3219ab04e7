"""Each rule of the tree can fail, says where, and lets go of what is fine."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

RULES = Path(__file__).parents[2] / "script" / "lib" / "tree_rules.py"


def run_rules(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(RULES), str(root), *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def write(root: Path, name: str, content: str) -> None:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)


# Put together here, so that this file keeps the rule that it tests.
MACHINE_PATH = "/" + "home/ada/volumes"


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("codec/src/long.cpp", "//\n" * 501, "501 lines"),
        ("store/octobrick/__init__.py", "", "regular package"),
        ("docs/guide.md", f"first\nput it in {MACHINE_PATH}\n", f"line 2 names {MACHINE_PATH[:9]}"),
    ],
)
def test_broken_rule_names_the_file_and_the_remedy(
    tmp_path: Path, name: str, content: str, complaint: str
) -> None:
    write(tmp_path, name, content)
    done = run_rules(tmp_path)
    assert done.returncode == 1
    assert done.stdout.startswith(f"{name}: ")
    assert complaint in done.stdout


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("codec/src/short.cpp", "//\n" * 500),
        ("docs/long.md", "text\n" * 2000),
        ("store/octobrick/store/__init__.py", ""),
        (
            "docs/guide.md",
            f"https://example.org{MACHINE_PATH} and ..{MACHINE_PATH} and usr/home/x\n",
        ),
        ("data/head.raw", f"\0{MACHINE_PATH}"),
    ],
)
def test_what_is_fine_passes(tmp_path: Path, name: str, content: str) -> None:
    write(tmp_path, name, content)
    done = run_rules(tmp_path)
    assert (done.returncode, done.stdout) == (0, "")


def test_without_git_the_output_of_tools_is_left_out(tmp_path: Path) -> None:
    for name in ("a.py", "build/b.py", ".venv/c.py", "demo/head.zarr/d.py", "x/__pycache__/e.py"):
        write(tmp_path, name, "")
    assert run_rules(tmp_path, "--list", "*.py").stdout == "a.py\0"


def test_with_git_ignored_files_are_left_out_and_new_ones_are_not(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "--quiet", tmp_path], check=True)
    for name in ("kept.py", "new.sh", "ignored.py"):
        write(tmp_path, name, "")
    write(tmp_path, ".gitignore", "ignored.py\n")
    subprocess.run(["git", "-C", tmp_path, "add", "kept.py"], check=True)
    assert run_rules(tmp_path, "--list", "*.py", "*.sh").stdout == "kept.py\0new.sh\0"
