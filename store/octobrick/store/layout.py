"""The Zarr hierarchy of a volume: groups, arrays and OME-NGFF metadata.

zarr-python writes the metadata and the small arrays (ranges, fidelity); the bricks themselves go
into shards by our own writer, which needs no whole shard in memory.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.codecs import ZstdCodec

from octobrick.store.attributes import VolumeAttributes
from octobrick.store.brick_codec import BrickCodec, zarr_serializer
from octobrick.store.brick_encoder import NO_DIRECTION

MANIFEST_NAME = "manifest.json"
METADATA_NBYTES_MAX = 64 * 2**20  # a manifest of half a million shards; more is not ours
_AXES = ("t", "c", "z", "y", "x")
_SMALL_CHUNK = 64  # bricks per axis in a chunk of ranges or fidelity: at most 2 MiB of float32


@dataclass(frozen=True, slots=True)
class BrickLayout:
    """How the bricks of every array of a volume lie in its shards.

    Args:
        brick: voxels per brick and axis.
        shard_bricks: bricks per shard and axis.
        zstd_level: of their frames.
    """

    brick: int
    shard_bricks: int
    zstd_level: int


def level_array(
    root: zarr.Group,
    path: str,
    shape_tczyx: tuple[int, int, int, int, int],
    dtype: np.dtype[np.generic],
    codec: BrickCodec,
    layout: BrickLayout,
) -> None:
    """Write the metadata of the array of one level, whose shards are there."""
    serializer = zarr_serializer(codec, dtype)
    _brick_array(root, path, shape_tczyx, dtype, serializer, layout, fill_value=0)


def directions_array(
    root: zarr.Group, path: str, shape_tczyx: tuple[int, int, int, int, int], layout: BrickLayout
) -> None:
    """Write the metadata of the array of the gradients of one level, whose shards are there."""
    shape, dtype = (*shape_tczyx, 3), np.dtype(np.uint8)
    _brick_array(
        root, path, shape, dtype, zarr_serializer(None, dtype), layout, fill_value=NO_DIRECTION
    )


def _brick_array(
    root: zarr.Group,
    path: str,
    shape: tuple[int, ...],
    dtype: np.dtype[np.generic],
    serializer: Any,
    layout: BrickLayout,
    *,
    fill_value: int,
) -> None:
    brick, shard = layout.brick, layout.brick * layout.shard_bricks
    vector = shape[5:]
    root.create_array(
        path,
        shape=shape,
        dtype=dtype,
        chunks=(1, 1, brick, brick, brick, *vector),
        shards=(1, 1, shard, shard, shard, *vector),
        serializer=serializer,
        compressors=ZstdCodec(level=layout.zstd_level, checksum=True),
        fill_value=fill_value,
        dimension_names=(*_AXES, *(None for _ in vector)),
    )


def small_array(root: zarr.Group, path: str, values: NDArray[np.generic]) -> None:
    """Write what is known per brick, (t, c, nz, ny, nx, 2)."""
    _, _, nz, ny, nx, _ = values.shape
    array = root.create_array(
        path,
        shape=values.shape,
        dtype=values.dtype,
        chunks=(1, 1, *(min(n, _SMALL_CHUNK) for n in (nz, ny, nx)), 2),
        compressors=ZstdCodec(level=3, checksum=True),
        fill_value=0,
        dimension_names=(*_AXES, None),
    )
    array[...] = values


def ome_attributes(name: str, attributes: VolumeAttributes) -> dict[str, Any]:
    """OME-NGFF 0.5 multiscales: a level's voxels are means, so each is shifted by half a voxel."""
    datasets = []
    for level in range(len(attributes.levels)):
        factor = 2**level
        scale = [s * factor for s in attributes.spacing_zyx]
        translation = [s * (factor - 1) / 2 for s in attributes.spacing_zyx]
        datasets.append(
            {
                "path": str(level),
                "coordinateTransformations": [
                    {"type": "scale", "scale": [1.0, 1.0, *scale]},
                    {"type": "translation", "translation": [0.0, 0.0, *translation]},
                ],
            }
        )
    space = {"type": "space"} | ({"unit": attributes.unit} if attributes.unit else {})
    axes = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}]
    axes += [{"name": axis} | space for axis in "zyx"]
    multiscale = {"name": name, "axes": axes, "datasets": datasets}
    return {"version": "0.5", "multiscales": [multiscale], "omero": _omero(attributes)}


def _omero(attributes: VolumeAttributes) -> dict[str, Any]:
    """How viewers show the channels, as OME-NGFF takes it over from OMERO."""
    names = attributes.source.get("channel_names") or []
    colors = attributes.source.get("channel_colors") or []
    (low, high), (dark, bright) = attributes.value_range, attributes.window
    window = {"min": low, "max": high, "start": dark, "end": bright}
    channels = []
    for c in range(attributes.nc):
        name, color = (own[c] if c < len(own) else None for own in (names, colors))
        label = str(name) if name else str(c)
        shown = {"label": label, "color": color or "ffffff", "window": window, "active": True}
        channels.append(shown)
    return {"channels": channels}


def write_root(
    root: zarr.Group, name: str, attributes: VolumeAttributes, manifest: Mapping[str, Any]
) -> str:
    """Write manifest and attributes, the last files of a volume; returns the revision."""
    revision = attributes.revision(manifest)
    octobrick = {"revision": revision, **attributes.to_json()}
    folder = Path(str(root.store.root))  # type: ignore[attr-defined]
    (folder / MANIFEST_NAME).write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")
    root.update_attributes({"ome": ome_attributes(name, attributes), "octobrick": octobrick})
    return revision
