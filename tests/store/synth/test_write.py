"""Files of procedural volumes: what is in them, what lies beside them, what is left of failures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError
from octobrick.store import Box, Progress
from octobrick.store.errors import DestinationError, DestinationExistsError
from octobrick.store.sources import open_source
from octobrick.store.synth import KINDS, planes, synth, write

SHAPE = (23, 34, 45)


@pytest.mark.parametrize("suffix", [".raw", ".npy"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32"])
def test_a_file_describes_itself_and_holds_the_planes(
    tmp_path: Path, dtype: str, suffix: str
) -> None:
    out = tmp_path / f"noise{suffix}"
    result = synth("fractal-noise", SHAPE, dtype, out, seed=4)
    expected = planes("fractal-noise", SHAPE, dtype, 0, 23, seed=4)
    with open_source(out) as source:
        assert (source.shape_zyx, source.dtype, source.warnings) == (SHAPE, np.dtype(dtype), ())
        np.testing.assert_array_equal(source.read(_all(SHAPE)), expected)
    assert result.nbytes == out.stat().st_size
    assert result.to_dict()["shape_zyx"] == SHAPE
    names = ["noise.npy"] if suffix == ".npy" else ["noise.raw", "noise.raw.json"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names


@pytest.mark.parametrize("kind", KINDS)
def test_neither_pieces_nor_threads_change_a_byte(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    synth(kind, SHAPE, "uint16", tmp_path / "a.npy", workers=1)
    monkeypatch.setattr(write, "_PIECE_NBYTES", 34 * 45 * 2 * 3)
    synth(kind, SHAPE, "uint16", tmp_path / "b.npy", workers=3)
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def test_colours_are_an_array_of_four_axes(tmp_path: Path) -> None:
    synth("wood", SHAPE, "uint8", tmp_path / "wood.npy", seed=1, rgb=True)
    np.testing.assert_array_equal(
        np.load(tmp_path / "wood.npy"), planes("wood", SHAPE, "uint8", 0, 23, seed=1, rgb=True)
    )


def test_the_sidecar_says_how_the_file_was_made(tmp_path: Path) -> None:
    synth("blocks", SHAPE, "uint8", tmp_path / "b.raw", seed=7)
    told = json.loads((tmp_path / "b.raw.json").read_text())
    assert told["shape"] == list(SHAPE)
    assert (told["kind"], told["seed"], told["dtype"]) == ("blocks", 7, "uint8")


def test_progress_ends_at_all_voxels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write, "_PIECE_NBYTES", 34 * 45 * 5)
    moments: list[Progress] = []
    synth("spheres", SHAPE, "uint8", tmp_path / "s.raw", progress=moments.append)
    assert len(moments) == 5
    assert moments[-1].done_voxels == moments[-1].total_voxels == 23 * 34 * 45


def test_nothing_is_left_of_a_failure(tmp_path: Path) -> None:
    def stop(_: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        synth("spheres", SHAPE, "uint8", tmp_path / "s.raw", progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_replaced_only_when_asked(tmp_path: Path) -> None:
    out = tmp_path / "s.raw"
    synth("spheres", SHAPE, "uint8", out)
    before = out.read_bytes()
    with pytest.raises(DestinationExistsError, match="--overwrite"):
        synth("blocks", SHAPE, "uint8", out)
    assert out.read_bytes() == before
    synth("blocks", SHAPE, "uint8", out, overwrite=True)
    assert out.read_bytes() != before


@pytest.mark.parametrize(
    ("name", "options", "word"),
    [
        ("v.tif", {}, r"\.raw or \.npy"),
        ("v.raw", {"rgb": True}, r"\.npy"),
        ("v.raw", {"workers": 0}, "workers 0"),
    ],
)
def test_wrong_arguments_are_told(
    tmp_path: Path, name: str, options: dict[str, object], word: str
) -> None:
    with pytest.raises(InvalidInputError, match=word):
        synth("wood", SHAPE, "uint8", tmp_path / name, **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(DestinationError, match="folder that exists"):
        synth("wood", SHAPE, "uint8", tmp_path / "no" / "v.raw")


def _all(shape: tuple[int, int, int]) -> Box:
    return Box.of_shape(shape)
