"""Small volumes in the formats of arrays: npz, HDF5 and Zarr."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .sample import SPACING_ZYX, Sample, Writer


def npz_stored(folder: Path, voxels: np.ndarray) -> Sample:
    np.savez(folder / "a.npz", only=voxels)
    return Sample(folder / "a.npz", voxels, {"spacing_zyx": SPACING_ZYX})


def npz_deflated_second_of_two(folder: Path, voxels: np.ndarray) -> Sample:
    np.savez_compressed(folder / "a.npz", other=np.zeros(3), wanted=voxels)
    return Sample(folder / "a.npz", voxels, {"spacing_zyx": SPACING_ZYX, "dataset": "wanted"})


WRITERS: tuple[Writer, ...] = (npz_stored, npz_deflated_second_of_two)
