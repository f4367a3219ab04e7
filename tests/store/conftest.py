from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from octobrick.store import Volume, ingest, open_volume

Voxels = NDArray[np.generic]


def smooth(shape: tuple[int, int, int], dtype: str = "uint16", seed: int = 0) -> Voxels:
    """A volume with structure, noise and no symmetry, over most of the type's range."""
    rng = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*(np.linspace(0, 3, n) for n in shape), indexing="ij")
    field = np.sin(2 * z + y) * np.cos(3 * x - z * y) + 0.05 * rng.standard_normal(shape)
    unit = (field - field.min()) / (np.ptp(field) or 1)
    if np.dtype(dtype).kind == "f":
        return (unit * 200 - 100).astype(dtype)
    info = np.iinfo(dtype)
    return np.rint(info.min + unit * (int(info.max) - int(info.min))).astype(dtype)


@pytest.fixture
def ingested(tmp_path: Path) -> Callable[..., Volume]:
    """Write an array as .npy, ingest it with the given options and open the volume."""

    def make(voxels: Voxels, name: str = "volume", **options: object) -> Volume:
        source = tmp_path / f"{name}.npy"
        np.save(source, voxels)
        ingest(source, tmp_path / f"{name}.zarr", **options)  # type: ignore[arg-type]
        return open_volume(tmp_path / f"{name}.zarr")

    return make
