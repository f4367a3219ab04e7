"""The tree is what pyproject.toml, the tools and CONTRIBUTING.md take it for."""

from __future__ import annotations

import os
import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CONTRACT = PROJECT["tool"]["importlinter"]["contracts"][0]
# From the top down: an import may only point towards the end of this list.
LAYERS = [name.removeprefix("octobrick.") for name in CONTRACT["layers"]]
COMMANDS = sorted(path for path in (ROOT / "script").iterdir() if path.is_file())


def test_layers_are_the_components_that_are_there() -> None:
    found = {path.parent.name for path in ROOT.glob("*/octobrick")}
    assert set(LAYERS) == found
    assert LAYERS == ["server", "measure", "renderer", "store", "codec"]


def test_every_tool_knows_every_component() -> None:
    modules = {f"octobrick.{name}" for name in LAYERS}
    folders = {f"octobrick/{name}": f"{name}/octobrick/{name}" for name in LAYERS}
    tools = PROJECT["tool"]
    assert set(tools["mypy"]["packages"]) == modules
    assert set(tools["mypy"]["mypy_path"]) == set(LAYERS)
    assert set(tools["importlinter"]["root_packages"]) == modules
    assert set(tools["ruff"]["src"]) == set(LAYERS)
    assert tools["scikit-build"]["wheel"]["packages"] == folders


@pytest.mark.parametrize("name", LAYERS)
def test_component_is_a_typed_part_of_the_namespace(name: str) -> None:
    part = ROOT / name / "octobrick"
    assert (part / name / "py.typed").is_file()
    assert (part / name / "__init__.py").is_file()
    assert not (part / "__init__.py").exists(), "octobrick is a PEP 420 namespace of five folders"
    assert (ROOT / "tests" / name).is_dir()


@pytest.mark.parametrize("command", COMMANDS, ids=lambda path: path.name)
def test_command_runs_from_anywhere_and_explains_itself(command: Path, tmp_path: Path) -> None:
    assert os.access(command, os.X_OK)
    # Help is for those whose machine is not set up yet: nothing is installed, no .venv.
    bare = {"PATH": "/usr/bin:/bin"}
    shown = subprocess.run([command, "-h"], cwd=tmp_path, env=bare, capture_output=True, text=True)
    assert shown.returncode == 0
    assert shown.stderr == ""
    assert f"script/{command.name}" in shown.stdout


def test_commands_are_those_that_the_documentation_names() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text()
    assert {path.name for path in COMMANDS} == set(re.findall(r"`script/([a-z-]+)", page))


def test_ci_runs_what_people_run() -> None:
    run = ROOT / ".ci" / "run"
    assert os.access(run, os.X_OK)
    code = [line for line in run.read_text().splitlines() if line and not line.startswith("#")]
    assert code == ["set -euo pipefail", 'exec "$(dirname "${BASH_SOURCE[0]}")/../script/test"']


def test_licence_is_the_one_that_the_package_declares() -> None:
    assert PROJECT["project"]["license"] == "Apache-2.0"
    text = (ROOT / "LICENSE").read_text()
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text
