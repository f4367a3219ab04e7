"""What the documents point at is there: files, commands, scripts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = (".", "bench", "data", "deploy", "docs", "tests")
DOCUMENTS = sorted(
    path
    for folder in FOLDERS
    for path in (ROOT / folder).glob("*.md" if folder == "." else "**/*.md")
)
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)")
# In code: a path that begins with a folder of the tree, without placeholders.
PATH = re.compile(
    r"(?<![\w./-])((?:codec|store|renderer|measure|server|script|tests|docs|bench|data|deploy)/[\w./-]*\w)"
)
CODE = re.compile(r"```.*?```|`[^`\n]+`", re.DOTALL)


def ids(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_contributing_and_readme_are_among_the_documents() -> None:
    assert {"CONTRIBUTING.md", "README.md", "CHANGELOG.md"} <= set(map(ids, DOCUMENTS))


@pytest.mark.parametrize("document", DOCUMENTS, ids=ids)
def test_links_lead_somewhere(document: Path) -> None:
    text = CODE.sub("", document.read_text(encoding="utf-8"))
    gone = [link for link in LINK.findall(text) if not (document.parent / link).exists()]
    assert not gone


@pytest.mark.parametrize("document", [ROOT / "README.md", ROOT / "CONTRIBUTING.md"], ids=ids)
def test_paths_in_code_are_there(document: Path) -> None:
    code = "\n".join(CODE.findall(document.read_text(encoding="utf-8")))
    gone = [path for path in PATH.findall(code) if not (ROOT / path).exists()]
    assert not gone
