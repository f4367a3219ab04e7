"""``octobrick export``: what it writes, prints and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from octobrick.server.cli import main
from octobrick.store import Volume, ingest, open_volume

VOXELS = np.arange(20 * 24 * 28, dtype=np.uint16).reshape(20, 24, 28)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["export", *map(str, arguments)])


@pytest.fixture
def volume(tmp_path: Path) -> Volume:
    np.save(tmp_path / "ramp.npy", VOXELS)
    ingest(tmp_path / "ramp.npy", tmp_path / "ramp.zarr", codec=None, brick=16, spacing=(3, 2, 1))
    (tmp_path / "ramp.npy").unlink()
    return open_volume(tmp_path / "ramp.zarr")


def test_a_volume_is_written_and_told_of(tmp_path: Path, volume: Volume) -> None:
    result = run(volume.path, tmp_path / "v.npy")
    assert result.exit_code == 0, result.stderr
    np.testing.assert_array_equal(np.load(tmp_path / "v.npy"), VOXELS)
    assert "20×24×28" in result.stdout
    assert "MB/s, peak memory" in result.stdout
    assert "v.npy (npy)" in result.stdout
    assert "octobrick: warning: npy does not hold spacing" in result.stderr


def test_json_is_all_there_is_on_stdout(tmp_path: Path, volume: Volume) -> None:
    told = json.loads(run(volume.path, tmp_path / "v.ome.zarr", "--json").stdout)
    assert (told["format"], told["levels"], told["shape_zyx"]) == ("ome-zarr", 2, [20, 24, 28])


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        ("2:5,1:24,0:9", (slice(2, 5), slice(1, 24), slice(0, 9))),
        (":,3:,:7", (slice(None), slice(3, None), slice(None, 7))),
    ],
)
def test_a_box_is_written(
    tmp_path: Path, volume: Volume, box: str, expected: tuple[slice, slice, slice]
) -> None:
    assert run(volume.path, tmp_path / "v.npy", "--box", box, "--quiet").output == ""
    np.testing.assert_array_equal(np.load(tmp_path / "v.npy"), VOXELS[expected])


def test_a_level_is_written(tmp_path: Path, volume: Volume) -> None:
    assert run(volume.path, tmp_path / "v.npy", "--level", 1, "--box", ":,:,2:").exit_code == 0
    np.testing.assert_array_equal(np.load(tmp_path / "v.npy"), volume.read(1)[:, :, 2:])


@pytest.mark.parametrize(
    ("arguments", "exit_code", "kind"),
    [
        (["{no}", "{out}.npy"], 1, "volume-not-found"),
        (["{volume}", "{out}.xyz"], 2, "invalid-input"),
        (["{volume}", "{volume}", "--overwrite"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--level", "7"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--level", "7", "--box", ":,:,:"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--box", "1:2"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--box", "1:2,3:4,-5:6"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--box", "0:99,:,:"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--t", "1"], 2, "invalid-input"),
        (["{volume}", "{out}.npy", "--active", "3:"], 2, "invalid-input"),
        (["{volume}", "{out}.vdb", "--active", "7"], 2, "invalid-input"),
        (["{volume}", "{out}.vdb", "--active", "7:x"], 2, "invalid-input"),
        (["{volume}", "{out}.vdb", "--active", "7:-5"], 2, "invalid-input"),
        (["{volume}", "{there}"], 1, "destination-exists"),
    ],
)
def test_a_bad_call_is_one_line_and_leaves_nothing(
    tmp_path: Path, volume: Volume, arguments: list[str], exit_code: int, kind: str
) -> None:
    there = tmp_path / "there.npy"
    there.touch()
    names = {
        "volume": volume.path,
        "out": tmp_path / "v",
        "no": tmp_path / "no.zarr",
        "there": there,
    }
    result = run(*(argument.format(**names) for argument in arguments))
    assert result.exit_code == exit_code
    assert result.stderr.startswith(f"octobrick: error [{kind}]: ")
    assert result.stderr.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ramp.zarr", "there.npy"]
