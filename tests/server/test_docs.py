"""The pages on errors and on the command line are true, and complete."""

from __future__ import annotations

import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

import octobrick.codec
import octobrick.renderer
import octobrick.server
import octobrick.store
from octobrick.codec.errors import OctobrickError
from octobrick.server.cli import main
from octobrick.server.errors import answer_to

DOCS = Path(__file__).parents[2] / "docs"


def error_classes() -> list[type[OctobrickError]]:
    """Every error class of every component, wherever it is defined."""
    for component in (octobrick.codec, octobrick.store, octobrick.renderer, octobrick.server):
        for module in pkgutil.walk_packages(component.__path__, f"{component.__name__}."):
            importlib.import_module(module.name)

    def below(cls: type[OctobrickError]) -> Iterator[type[OctobrickError]]:
        yield cls
        for child in cls.__subclasses__():
            yield from below(child)

    return [cls for cls in below(OctobrickError) if cls.__module__.startswith("octobrick.")]


def test_every_kind_is_documented_with_its_class_and_status_and_no_other() -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| `(\w+)` \| (\d+) \|", _read("errors.md"), re.MULTILINE)
    expected = {(cls.kind, cls.__name__, str(answer_to(cls).status)) for cls in error_classes()}
    assert set(rows) == expected
    assert len(rows) == len(expected)


def test_no_two_errors_share_a_kind() -> None:
    kinds = [cls.kind for cls in error_classes()]
    assert sorted(kinds) == sorted(set(kinds))


@pytest.mark.parametrize("name", sorted(main.commands))
def test_every_option_of_a_command_is_documented_and_no_other(name: str) -> None:
    page = _read("cli.md")
    section = re.search(rf"^## `octobrick {name} [^\n]*`\n(.*?)(?=^## |\Z)", page, re.M | re.S)
    assert section, f"docs/cli.md has no section for {name}"
    documented = set(re.findall(r"^\| `([^`]+)` \|", section[1], re.MULTILINE))
    options = {
        ", ".join(parameter.opts + parameter.secondary_opts)
        for parameter in main.commands[name].params
        if isinstance(parameter, click.Option)
    }
    assert documented == options


def test_no_section_for_a_command_that_does_not_exist() -> None:
    assert set(re.findall(r"^## `octobrick ([\w-]+)", _read("cli.md"), re.M)) == set(main.commands)


def _read(name: str) -> str:
    return (DOCS / name).read_text()
