"""Small volumes in the formats of arrays: npz, HDF5 and Zarr."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from .sample import SPACING_ZYX, Sample, Writer


def npz_stored(folder: Path, voxels: np.ndarray) -> Sample:
    np.savez(folder / "a.npz", only=voxels)
    return Sample(folder / "a.npz", voxels, {"spacing_zyx": SPACING_ZYX})


def npz_deflated_second_of_two(folder: Path, voxels: np.ndarray) -> Sample:
    np.savez_compressed(folder / "a.npz", other=np.zeros(3), wanted=voxels)
    return Sample(folder / "a.npz", voxels, {"spacing_zyx": SPACING_ZYX, "dataset": "wanted"})


def hdf5_chunked_big_endian(folder: Path, voxels: np.ndarray) -> Sample:
    stored = voxels if voxels.dtype == bool else voxels.astype(voxels.dtype.newbyteorder(">"))
    with h5py.File(folder / "a.h5", "w", libver="latest") as file:
        chunks = tuple(min(3, size) for size in voxels.shape)
        dataset = file.create_dataset(
            "deep/volume", data=stored, chunks=chunks, compression="gzip", fletcher32=True
        )
        dataset.attrs["element_size_um"] = SPACING_ZYX
    return Sample(folder / "a.h5", voxels)


def hdf5_contiguous_x_first(folder: Path, voxels: np.ndarray) -> Sample:
    with h5py.File(folder / "a.hdf5", "w") as file:
        file["volume"] = np.ascontiguousarray(voxels.T)
    options = {"axes": "xyz", "dataset": "/volume", "spacing_zyx": SPACING_ZYX}
    return Sample(folder / "a.hdf5", voxels, options)


WRITERS: tuple[Writer, ...] = (
    npz_stored,
    npz_deflated_second_of_two,
    hdf5_chunked_big_endian,
    hdf5_contiguous_x_first,
)
