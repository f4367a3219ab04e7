"""OME-Zarr 0.5 with standard codecs only, all levels from the one that is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import zarr
from zarr.codecs import BytesCodec, ZstdCodec

from octobrick.store.box import Box, cell_box, cells_touching
from octobrick.store.export.losses import losses
from octobrick.store.export.options import WriterOptions
from octobrick.store.export.region import Region

_AXES = ("t", "c", "z", "y", "x")
_SHARD_SIDE = 256  # voxels, about: a shard is what is held in memory
_ZSTD_LEVEL = 3


def write_ome_zarr(region: Region, path: Path, options: WriterOptions) -> list[str]:  # noqa: ARG001
    """Write a region of every level, shard by shard; returns what OME-Zarr cannot hold.

    Chunks are the volume's bricks. Neuroglancer, napari, TensorStore and zarr-python read it
    without octobrick.
    """
    root = zarr.create_group(path)
    levels = list(levels_of(region))
    for index, level in enumerate(levels):
        _write_level(root, str(index), level)
    root.update_attributes({"ome": _attributes(levels)})
    return losses(region, "OME-Zarr", "direction", "rescale")


def levels_of(region: Region) -> Iterator[Region]:
    """The region at its own level and at all coarser ones."""
    level: Region | None = region
    while level is not None:
        yield level
        level = level.coarser()


def _write_level(root: zarr.Group, name: str, region: Region) -> None:
    brick = region.volume.brick_shape_zyx[0]
    shard = brick * max(1, _SHARD_SIDE // brick)
    dtype = region.dtype
    array = root.create_array(
        name,
        shape=(1, 1, *region.shape_zyx),
        dtype=dtype,
        chunks=(1, 1, *(brick,) * 3),
        shards=(1, 1, *(shard,) * 3),
        serializer=BytesCodec(endian=None if dtype.itemsize == 1 else "little"),
        compressors=ZstdCodec(level=_ZSTD_LEVEL),
        fill_value=0,
        dimension_names=_AXES,
    )
    whole = Box.of_shape(region.shape_zyx)
    cell_zyx = (shard, shard, shard)
    for cell in cells_touching(whole, cell_zyx):
        box = cell_box(cell, cell_zyx).intersect(whole)
        array[(0, 0, *box.slices)] = region.read(box)
        region.advance(box.nvoxels)


def _attributes(levels: list[Region]) -> dict[str, Any]:
    """Multiscales, and a channel with the window that is worth showing."""
    first = levels[0]
    unit = {"unit": first.unit} if first.unit else {}
    axes: list[dict[str, Any]] = [
        {"name": "t", "type": "time"},
        {"name": "c", "type": "channel"},
        *({"name": name, "type": "space", **unit} for name in "zyx"),
    ]
    volume = first.volume
    (low, high), (dark, bright) = volume.value_range, volume.window
    window = {"min": low, "max": high, "start": dark, "end": bright}
    channel = {"label": volume.name, "color": "FFFFFF", "active": True, "window": window}
    datasets = [
        {"path": str(index), "coordinateTransformations": _transformations(level)}
        for index, level in enumerate(levels)
    ]
    multiscale = {"name": volume.name, "axes": axes, "datasets": datasets, "type": "mean"}
    return {"version": "0.5", "multiscales": [multiscale], "omero": {"channels": [channel]}}


def _transformations(region: Region) -> list[dict[str, Any]]:
    scale = [1.0, 1.0, *reversed(region.spacing_xyz)]
    translation = [0.0, 0.0, *reversed(region.aligned_origin_xyz)]
    return [
        {"type": "scale", "scale": scale},
        {"type": "translation", "translation": translation},
    ]
