"""Small volumes in the formats of arrays: npz, HDF5 and Zarr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import zarr

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


def _chunk_of(voxels: np.ndarray) -> tuple[int, ...]:
    return tuple(min(3, size) for size in voxels.shape)


def zarr2_array_big_endian(folder: Path, voxels: np.ndarray) -> Sample:
    stored = voxels if voxels.dtype == bool else voxels.astype(voxels.dtype.newbyteorder(">"))
    array = zarr.create_array(
        folder / "a.zarr",
        shape=voxels.shape,
        dtype=stored.dtype,
        chunks=voxels.shape,
        zarr_format=2,
        overwrite=True,
    )
    array[:] = stored
    return Sample(folder / "a.zarr", voxels, {"spacing_zyx": SPACING_ZYX})


def ome_zarr_0_4(folder: Path, voxels: np.ndarray) -> Sample:
    group = zarr.create_group(folder / "a", zarr_format=2, overwrite=True)
    array = group.create_array("s0", shape=voxels.shape, dtype=voxels.dtype, chunks=voxels.shape)
    array[:] = voxels
    group.attrs["multiscales"] = multiscales("zyx", ["s0"], SPACING_ZYX, "0.4")
    return Sample(folder / "a", voxels)


def ome_zarr_0_5_sharded_x_first(folder: Path, voxels: np.ndarray) -> Sample:
    group = zarr.create_group(folder / "a.ome.zarr", zarr_format=3, overwrite=True)
    chunk = _chunk_of(voxels.T)
    shape = tuple(-(-size // step) * step for size, step in zip(voxels.T.shape, chunk, strict=True))
    array = group.create_array(
        "0", shape=voxels.T.shape, dtype=voxels.dtype, chunks=chunk, shards=shape
    )
    array[:] = voxels.T
    group.attrs["ome"] = {
        "version": "0.5",
        "multiscales": multiscales("xyz", ["0"], SPACING_ZYX[::-1], None),
    }
    return Sample(folder / "a.ome.zarr", voxels)


def multiscales(
    letters: str, paths: list[str], scale: tuple[float, ...], version: str | None
) -> list[dict[str, Any]]:
    """The attribute of an image whose levels are each half as fine as the one before."""
    types = {"t": "time", "c": "channel"}
    image = {
        "axes": [{"name": letter, "type": types.get(letter, "space")} for letter in letters],
        "datasets": [
            {
                "path": path,
                "coordinateTransformations": [
                    {"type": "scale", "scale": [size * 2**level for size in scale]}
                ],
            }
            for level, path in enumerate(paths)
        ],
    }
    return [image | ({"version": version} if version else {})]


WRITERS: tuple[Writer, ...] = (
    npz_stored,
    npz_deflated_second_of_two,
    hdf5_chunked_big_endian,
    hdf5_contiguous_x_first,
    zarr2_array_big_endian,
    ome_zarr_0_4,
    ome_zarr_0_5_sharded_x_first,
)
