"""OpenVDB: what is handed to the writer, and what it makes of it where it is there."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, UnsupportedError
from octobrick.store import Box, Volume
from octobrick.store.export import export
from octobrick.store.sources import open_source

from .conftest import DIRECTION, ORIGIN_XYZ, SPACING_XYZ, steps

Lossless = Callable[..., Volume]
SHAPE = (37, 29, 43)
WRITER = "octobrick.store.vdb_writer"
EXTENSION = "octobrick.store._vdb"


@pytest.fixture
def handed(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a writer that only listens is given."""
    calls: dict[str, Any] = {}

    def write_vdb(path: Path, boxes: Iterator[tuple[Any, Any]], **options: Any) -> int:
        voxels = np.full(SHAPE, -1, np.float32)
        for (z, y, x), box in boxes:
            assert box.dtype == np.float32
            nz, ny, nx = box.shape
            voxels[z : z + nz, y : y + ny, x : x + nx] = box
        path.write_bytes(b"vdb")
        calls.update(options, voxels=voxels)
        return voxels.size

    module = ModuleType(WRITER)
    module.write_vdb = write_vdb  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, WRITER, module)
    return calls


def test_the_writer_gets_all_voxels_and_their_place(
    tmp_path: Path, lossless: Lossless, handed: dict[str, Any]
) -> None:
    voxels = steps(SHAPE)
    with lossless(voxels) as volume:
        result = export(volume, tmp_path / "v.vdb", active=(3, 9))
    np.testing.assert_array_equal(handed["voxels"], voxels)
    assert (handed["dtype"], handed["active"]) == ("float32", (3, 9))
    assert handed["spacing_zyx"] == SPACING_XYZ[::-1]
    np.testing.assert_allclose(handed["origin_xyz"], np.linalg.solve(DIRECTION, ORIGIN_XYZ))
    assert (tmp_path / "v.vdb").read_bytes() == b"vdb"
    for word in ("unit", "direction"):
        assert word in result.warnings[0]


def test_without_a_writer_the_format_is_not_supported(
    tmp_path: Path, lossless: Lossless, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, WRITER, None)
    with lossless(steps((4, 4, 4))) as volume, pytest.raises(UnsupportedError, match="OpenVDB"):
        export(volume, tmp_path / "v.vdb")
    assert [path.name for path in tmp_path.iterdir()] == ["v.zarr"]


@pytest.mark.parametrize(
    ("name", "active", "word"),
    [("v.npy", (0, 1), "keeps all"), ("v.vdb", (2, 1), "none"), ("v.vdb", (0, np.nan), "none")],
)
def test_an_active_range_that_makes_no_sense_is_told(
    tmp_path: Path, lossless: Lossless, name: str, active: tuple[float, float], word: str
) -> None:
    with lossless(steps((4, 4, 4))) as volume, pytest.raises(InvalidInputError, match=word):
        export(volume, tmp_path / name, active=active)


@pytest.mark.skipif(
    importlib.util.find_spec(EXTENSION) is None, reason="octobrick was built without OpenVDB"
)
@pytest.mark.parametrize("active", [None, (60.0, np.inf)])
def test_active_voxels_come_back(
    tmp_path: Path, lossless: Lossless, active: tuple[float, float] | None
) -> None:
    voxels = steps(SHAPE)
    voxels[0, 0, 0] = voxels[-1, -1, -1] = 100  # so that active voxels reach both ends
    with lossless(voxels) as volume:
        export(volume, tmp_path / "v.vdb", active=active)
    expected = np.where(voxels >= (active or (0, 0))[0], voxels, 0).astype(np.float32)
    with open_source(tmp_path / "v.vdb") as source:
        np.testing.assert_array_equal(source.read(Box.of_shape(source.shape_zyx)), expected)
        np.testing.assert_allclose(source.spacing_zyx, SPACING_XYZ[::-1])
        np.testing.assert_allclose(source.origin_xyz, np.linalg.solve(DIRECTION, ORIGIN_XYZ))
