"""``octobrick synth``: what it writes, prints and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from octobrick.server.cli import main
from octobrick.server.cli.synth import DTYPES
from octobrick.server.cli.synth import KINDS as OFFERED
from octobrick.store.synth import KINDS, SYNTH_DTYPES, planes


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["synth", *map(str, arguments)])


def test_kinds_and_types_offered_are_those_there_are() -> None:
    assert (OFFERED, DTYPES) == (KINDS, SYNTH_DTYPES)


def test_a_volume_is_written_and_told_of(tmp_path: Path) -> None:
    out = tmp_path / "v.npy"
    result = run("spheres", out, "--shape", "12,20,24", "--dtype", "int16", "--seed", 9)
    assert result.exit_code == 0, result.stderr
    np.testing.assert_array_equal(
        np.load(out), planes("spheres", (12, 20, 24), "int16", 0, 12, seed=9)
    )
    assert "12×20×24 voxels" in result.stdout
    assert "Mvoxel/s, peak memory" in result.stdout


def test_json_is_all_there_is_on_stdout_and_the_file_can_be_ingested(tmp_path: Path) -> None:
    raw, dest = tmp_path / "v.raw", tmp_path / "v.zarr"
    told = json.loads(run("marble", raw, "--shape", "8,9,10", "--json").stdout)
    assert (told["kind"], told["dtype"], told["nbytes"]) == ("marble", "uint8", 720)
    assert CliRunner().invoke(main, ["ingest", str(raw), str(dest), "--quiet"]).exit_code == 0


def test_colours_are_written(tmp_path: Path) -> None:
    result = run("wood", tmp_path / "w.npy", "--shape", "3,4,5", "--rgb", "--quiet")
    assert (result.exit_code, result.output) == (0, "")
    assert np.load(tmp_path / "w.npy").shape == (3, 4, 5, 3)


@pytest.mark.parametrize(
    ("arguments", "exit_code", "kind"),
    [
        (["cubes", "{out}", "--shape", "4,4,4"], 2, "invalid-input"),
        (["blocks", "{out}"], 2, "invalid-input"),
        (["blocks", "{out}", "--shape", "4,4"], 2, "invalid-input"),
        (["blocks", "{out}", "--shape", "4,4,0"], 2, "invalid-input"),
        (["blocks", "{out}.tif", "--shape", "4,4,4"], 2, "invalid-input"),
        (["blocks", "{there}", "--shape", "4,4,4"], 1, "destination-exists"),
    ],
)
def test_a_bad_call_is_one_line_and_leaves_nothing(
    tmp_path: Path, arguments: list[str], exit_code: int, kind: str
) -> None:
    there = tmp_path / "there.raw"
    there.touch()
    names = {"out": tmp_path / "v.raw", "there": there}
    result = run(*(argument.format(**names) for argument in arguments))
    assert result.exit_code == exit_code
    assert result.stderr.startswith(f"octobrick: error [{kind}]: ")
    assert result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == [there]
