from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.store import Volume, ingest, open_volume

Voxels = NDArray[np.generic]

SPACING_XYZ = (0.5, 0.75, 2.0)
ORIGIN_XYZ = (-10.0, 20.0, 5.5)
# A rotation about two axes with a flip: nothing is symmetrical, and every component is exact.
DIRECTION = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])


def steps(shape: tuple[int, int, int], dtype: str = "uint16") -> Voxels:
    """Voxels that all differ from their neighbours."""
    values = np.random.default_rng(3).integers(0, 120, shape)
    return values.astype(dtype)


@pytest.fixture
def lossless(tmp_path: Path) -> Callable[..., Volume]:
    """A volume of these voxels, by way of a NRRD with spacing, unit, direction and origin."""

    def make(voxels: Voxels, name: str = "v", **options: object) -> Volume:
        import nrrd

        source = tmp_path / f"{name}-source.nrrd"
        header = {
            "space": "left-posterior-superior",
            "space directions": (DIRECTION * SPACING_XYZ).T,
            "space origin": ORIGIN_XYZ,
            "space units": ["mm"] * 3,
            "encoding": "raw",
        }
        nrrd.write(str(source), voxels.transpose(2, 1, 0), header)
        arguments = {"codec": None, "brick": 16, "shard": 2} | options
        ingest(source, tmp_path / f"{name}.zarr", **arguments)  # type: ignore[arg-type]
        source.unlink()
        return open_volume(tmp_path / f"{name}.zarr")

    return make
