"""OpenVDB files for the contract and the fuzzing; none where octobrick is built without it."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.store.vdb_writer import write_vdb

from .sample import SPACING_ZYX, Sample

HAS_OPENVDB = importlib.util.find_spec("octobrick.store._vdb") is not None


def openvdb_whole(folder: Path, voxels: np.ndarray) -> Sample:
    return _write(folder / "a.vdb", [((0, 0, 0), voxels)], voxels)


def openvdb_in_pieces_far_away(folder: Path, voxels: np.ndarray) -> Sample:
    pieces = [((z - 300, -5, 4090), voxels[z : z + 1]) for z in range(len(voxels))]
    return _write(folder / "a.vdb", pieces, voxels)


def _write(path: Path, boxes: list[Any], voxels: np.ndarray) -> Sample:
    """Of 16-bit voxels a grid of int32 is made: there is none of less."""
    write_vdb(path, boxes, dtype=voxels.dtype, spacing_zyx=SPACING_ZYX)
    return Sample(path, voxels if voxels.dtype == "float32" else voxels.astype("int32"), {})


OPENVDB_WRITERS = (openvdb_whole, openvdb_in_pieces_far_away) if HAS_OPENVDB else ()
for _writer in OPENVDB_WRITERS:
    _writer.dtypes = ("float32",)  # type: ignore[attr-defined]  # of those of the contract
