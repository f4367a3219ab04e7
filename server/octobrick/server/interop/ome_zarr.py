"""A volume as OME-Zarr with standard codecs: 0.5 on Zarr v3, and 0.4 on Zarr v2.

Both have one chunk for each brick, and the same bytes in it: little-endian voxels (z, y, x), of the
full brick shape, in one zstd frame. That is what is on disk where a level is lossless.
Specifications: ngff.openmicroscopy.org (0.4, 0.5), zarr-specs.readthedocs.io (v2, v3).
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from octobrick.server.interop.resources import INDEX, Chunk, Document, Resource, nothing
from octobrick.store import LocalVolume
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx
from octobrick.store.volume_files import read_json

ZSTD_LEVEL = 1
"""Frames are made while a client waits: the fastest level that has a number."""

_AXES = ("t", "c", "z", "y", "x")
_ARRAY = re.compile(INDEX + r"/(zarr\.json|\.zarray|\.zattrs)")
_PLACE = "/".join([INDEX] * 5)
_V3_CHUNK = re.compile(f"{INDEX}/c/{_PLACE}")
_V2_CHUNK = re.compile(f"{INDEX}/{_PLACE}")

Json = dict[str, Any]


def find_v3(volume: LocalVolume, key: str) -> Resource:
    """What a key of the Zarr v3 hierarchy names.

    Raises:
        NotFoundError: nothing.
    """
    if key == "zarr.json":
        return Document.of(group_v3(volume))
    level = _array_level(volume, key, "zarr.json")
    if level is not None:
        return Document.of(array_v3(volume, level))
    return _chunk(volume, _V3_CHUNK, key)


def find_v2(volume: LocalVolume, key: str) -> Resource:
    """What a key of the Zarr v2 hierarchy names.

    Raises:
        NotFoundError: nothing.
    """
    documents = {".zgroup": lambda _: _GROUP_V2, ".zattrs": attributes_v2, ".zmetadata": _all_v2}
    if key in documents:
        return Document.of(documents[key](volume))
    level = _array_level(volume, key, ".zarray")
    if level is not None:
        return Document.of(array_v2(volume, level))
    if _array_level(volume, key, ".zattrs") is not None:
        return Document.of(_DIMENSIONS_V2)
    return _chunk(volume, _V2_CHUNK, key)


def group_v3(volume: LocalVolume) -> Json:
    """The group's ``zarr.json``, with that of each array in it, so that one request tells all."""
    arrays = {str(level.index): array_v3(volume, level.index) for level in volume.levels}
    return {
        "zarr_format": 3,
        "node_type": "group",
        "attributes": {"ome": _stored_ome(volume)},
        "consolidated_metadata": {"kind": "inline", "must_understand": False, "metadata": arrays},
    }


def array_v3(volume: LocalVolume, level: int) -> Json:
    """The ``zarr.json`` of a level."""
    codecs = [
        {"name": "bytes", "configuration": {"endian": "little"}},
        {"name": "zstd", "configuration": {"level": ZSTD_LEVEL, "checksum": True}},
    ]
    grid = {"name": "regular", "configuration": {"chunk_shape": _chunk_shape(volume)}}
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": _shape(volume, level),
        "data_type": volume.dtype.name,
        "chunk_grid": grid,
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": _fill_value(volume),
        "codecs": codecs,
        "attributes": {},
        "dimension_names": list(_AXES),
        "storage_transformers": [],
    }


_GROUP_V2: Json = {"zarr_format": 2}
_DIMENSIONS_V2: Json = {"_ARRAY_DIMENSIONS": list(_AXES)}  # as xarray names the axes of Zarr v2


def attributes_v2(volume: LocalVolume) -> Json:
    """The group's ``.zattrs``: OME-NGFF 0.4 has the words of 0.5, without the ``ome`` around."""
    ome = _stored_ome(volume)
    images = [image | {"version": "0.4"} for image in ome.get("multiscales", [])]
    return {name: ome[name] for name in ("omero",) if name in ome} | {"multiscales": images}


def array_v2(volume: LocalVolume, level: int) -> Json:
    """The ``.zarray`` of a level."""
    return {
        "zarr_format": 2,
        "shape": _shape(volume, level),
        "chunks": _chunk_shape(volume),
        "dtype": volume.dtype.newbyteorder("<").str,
        "compressor": {"id": "zstd", "level": ZSTD_LEVEL},
        "fill_value": _fill_value(volume),
        "order": "C",
        "filters": None,
        "dimension_separator": "/",
    }


def _all_v2(volume: LocalVolume) -> Json:
    documents: Json = {".zgroup": _GROUP_V2, ".zattrs": attributes_v2(volume)}
    for level in volume.levels:
        documents[f"{level.index}/.zarray"] = array_v2(volume, level.index)
        documents[f"{level.index}/.zattrs"] = _DIMENSIONS_V2
    return {"zarr_consolidated_format": 1, "metadata": documents}


def brick_frame(volume: LocalVolume, level: int, brick_zyx: Zyx, t: int, c: int) -> bytes | None:
    """The voxels of a brick in one zstd frame, as stored if they are stored so; None if absent.

    Raises:
        CorruptBrickError: naming the file and the brick.
    """
    stored = volume.stored_brick(level, brick_zyx, t, c)
    if stored is None or volume.level_codec(level) is None:
        return stored
    voxels = volume.brick(level, brick_zyx, t, c)
    return zstd_frame.compress(little_bytes(voxels), ZSTD_LEVEL)


def little_bytes(voxels: np.ndarray[Any, np.dtype[Any]]) -> memoryview:
    """Voxels as little-endian bytes in C order, copied only where they are not so already."""
    little = voxels.astype(voxels.dtype.newbyteorder("<"), order="C", copy=False)
    return little.reshape(-1).view(np.uint8).data


def _chunk(volume: LocalVolume, pattern: re.Pattern[str], key: str) -> Chunk:
    match = pattern.fullmatch(key)
    if match is None:
        raise nothing(key)
    level, t, c, z, y, x = (int(index) for index in match.groups())
    if level >= len(volume.levels) or t >= volume.nt or c >= volume.nc:
        raise nothing(key)
    if not all(i < n for i, n in zip((z, y, x), volume.levels[level].grid_zyx, strict=True)):
        raise nothing(key)
    return Chunk(
        name=("brick", *match.groups()),
        read=lambda volume: brick_frame(volume, level, (z, y, x), t, c),
        is_stored=volume.level_codec(level) is None,
        is_content=True,
    )


def _array_level(volume: LocalVolume, key: str, name: str) -> int | None:
    match = _ARRAY.fullmatch(key)
    if match is None or match[2] != name or int(match[1]) >= len(volume.levels):
        return None
    return int(match[1])


def _stored_ome(volume: LocalVolume) -> Json:
    """What the volume's own ``zarr.json`` says in the words of OME-NGFF, and nothing else of it."""
    ome = read_json(volume.path / "zarr.json", volume.path).get("attributes", {}).get("ome")
    return ome if isinstance(ome, dict) else {}


def _shape(volume: LocalVolume, level: int) -> list[int]:
    return [volume.nt, volume.nc, *volume.levels[level].shape_zyx]


def _chunk_shape(volume: LocalVolume) -> list[int]:
    return [1, 1, *volume.brick_shape_zyx]


def _fill_value(volume: LocalVolume) -> int | float:
    return float(volume.fill_value) if volume.dtype.kind == "f" else volume.fill_value
