"""A volume as Neuroglancer's precomputed format: one multiscale volume for each time step.

Each level is a scale and each brick a chunk, in encoding ``raw``: little-endian voxels, x fastest,
then y, z and channel, cut where the volume ends. Specification: github.com/google/neuroglancer,
src/datasource/precomputed/volume.md.
"""

from __future__ import annotations

import math
import re
from typing import Any, Final

import numpy as np

from octobrick.codec.errors import UnsupportedError
from octobrick.server.interop.ome_zarr import ZSTD_LEVEL, brick_frame, little_bytes
from octobrick.server.interop.resources import INDEX, Chunk, Document, Resource, nothing
from octobrick.store import LocalVolume
from octobrick.store import frame as zstd_frame
from octobrick.store.box import Zyx

DTYPES: Final = frozenset(
    {"uint8", "uint16", "uint32", "uint64", "int8", "int16", "int32", "float32"}
)
"""The sample types that Neuroglancer shows and TensorStore reads."""

CHUNK_NBYTES_MAX: Final = 128 * 2**20
"""A chunk has all channels, and is made in memory: more would let one request take too much."""

_NANOMETERS: Final = {
    "angstrom": 1e-1,
    "picometer": 1e-3,
    "nanometer": 1.0,
    "micrometer": 1e3,
    "millimeter": 1e6,
    "centimeter": 1e7,
    "decimeter": 1e8,
    "meter": 1e9,
    "kilometer": 1e12,
    "inch": 2.54e7,
    "foot": 3.048e8,
    "yard": 9.144e8,
    "mile": 1.609344e12,
}

_KEY = re.compile(f"(?:t/{INDEX}/)?(?:(info)|{INDEX}/" + "_".join([f"{INDEX}-{INDEX}"] * 3) + ")")


def find(volume: LocalVolume, key: str) -> Resource:
    """What a key names: ``info``, or ``{level}/{x0}-{x1}_{y0}-{y1}_{z0}-{z1}``, after ``t/{t}/``.

    Raises:
        NotFoundError: nothing; also voxels that are no chunk.
        UnsupportedError: the format has no such sample type, or a chunk would take too much.
    """
    match = _KEY.fullmatch(key)
    if match is None or int(match[1] or 0) >= volume.nt:
        raise nothing(key)
    require_supported(volume)
    if match[2]:
        return Document.of(info(volume))
    level, *bounds = (int(number) for number in match.groups()[2:])
    brick_zyx = None if level >= len(volume.levels) else _brick_of(volume, level, bounds)
    if brick_zyx is None:
        raise nothing(key)
    return _chunk(volume, int(match[1] or 0), level, brick_zyx)


def info(volume: LocalVolume) -> dict[str, Any]:
    """The ``info`` of any time step.

    Raises:
        UnsupportedError: the voxels are of a size that nanometres cannot say.
    """
    is_label = volume.metadata()["reducer"] == "mode" and volume.dtype.kind in "ui"
    return {
        "@type": "neuroglancer_multiscale_volume",
        "type": "segmentation" if is_label and volume.nc == 1 else "image",
        "data_type": volume.dtype.name,
        "num_channels": volume.nc,
        "scales": [
            {
                "key": str(level.index),
                "size": list(reversed(level.shape_zyx)),
                "resolution": resolution_nanometers_xyz(level.spacing_xyz, volume.unit),
                # A corner, not a centre: that of all levels is the same.
                "voxel_offset": [0, 0, 0],
                "chunk_sizes": [list(reversed(volume.brick_shape_zyx))],
                "encoding": "raw",
            }
            for level in volume.levels
        ],
    }


def resolution_nanometers_xyz(
    spacing_xyz: tuple[float, float, float], unit: str | None
) -> list[float]:
    """Nanometres of a voxel; a unit that is not known counts as a nanometre.

    Raises:
        UnsupportedError: that is not a positive finite number.
    """
    nanometers = [spacing * _NANOMETERS.get(unit or "", 1.0) for spacing in spacing_xyz]
    if not all(0 < n < math.inf for n in nanometers):
        raise UnsupportedError(
            f"Voxels of {spacing_xyz} {unit} have no size in nanometres; read the volume as "
            "OME-Zarr, or correct its spacing"
        )
    return nanometers


def require_supported(volume: LocalVolume) -> None:
    """Refuse what the format cannot hold, and chunks that are too large to make on the way.

    Raises:
        UnsupportedError: naming the sample type, or the size and the bound.
    """
    if volume.dtype.name not in DTYPES:
        raise UnsupportedError(
            f"The precomputed format has no {volume.dtype.name}, only {', '.join(sorted(DTYPES))}; "
            "read the volume as OME-Zarr",
            dtype=volume.dtype.name,
        )
    nbytes = math.prod(volume.brick_shape_zyx) * volume.dtype.itemsize * volume.nc
    if nbytes > CHUNK_NBYTES_MAX:
        raise UnsupportedError(
            f"A precomputed chunk of all {volume.nc} channels would take {nbytes} bytes, more "
            f"than {CHUNK_NBYTES_MAX}; read the volume as OME-Zarr",
            channels=volume.nc,
            nbytes=nbytes,
            limit=CHUNK_NBYTES_MAX,
        )


def chunk_frame(volume: LocalVolume, t: int, level: int, brick_zyx: Zyx) -> bytes | None:
    """All channels of a brick, cut to the volume, in one zstd frame; None if all are absent.

    Raises:
        CorruptBrickError: naming the file and the brick.
    """
    if _is_a_stored_brick(volume, level, brick_zyx):
        return brick_frame(volume, level, brick_zyx, t, 0)
    places = [(level, brick_zyx, t, c) for c in range(volume.nc)]
    if all(volume.stored_brick(*place) is None for place in places):
        return None
    shape_zyx = _cut_shape(volume, level, brick_zyx)
    nz, ny, nx = shape_zyx
    voxels = np.empty((volume.nc, *shape_zyx), volume.dtype)
    for place in places:
        voxels[place[3]] = volume.brick(*place)[:nz, :ny, :nx]
    return zstd_frame.compress(little_bytes(voxels), ZSTD_LEVEL)


def _chunk(volume: LocalVolume, t: int, level: int, brick_zyx: Zyx) -> Chunk:
    return Chunk(
        name=("box", *map(str, (level, t, *brick_zyx))),
        read=lambda volume: chunk_frame(volume, t, level, brick_zyx),
        is_stored=_is_a_stored_brick(volume, level, brick_zyx),
        is_content=False,
    )


def _is_a_stored_brick(volume: LocalVolume, level: int, brick_zyx: Zyx) -> bool:
    """Whether the chunk in a zstd frame is on disk: one lossless channel, and nothing to cut."""
    is_whole = _cut_shape(volume, level, brick_zyx) == volume.brick_shape_zyx
    return is_whole and volume.nc == 1 and volume.level_codec(level) is None


def _brick_of(volume: LocalVolume, level: int, bounds_xyz: list[int]) -> Zyx | None:
    """The brick that, cut to the level, is x0, x1, y0, y1, z0, z1; None where none is."""
    starts = list(reversed(bounds_xyz[::2]))
    z, y, x = (start // n for start, n in zip(starts, volume.brick_shape_zyx, strict=True))
    grid_zyx = volume.levels[level].grid_zyx
    if not all(i < n for i, n in zip((z, y, x), grid_zyx, strict=True)):
        return None
    return (z, y, x) if _bounds_xyz(volume, level, (z, y, x)) == bounds_xyz else None


def _bounds_xyz(volume: LocalVolume, level: int, brick_zyx: Zyx) -> list[int]:
    starts = [i * n for i, n in zip(brick_zyx, volume.brick_shape_zyx, strict=True)]
    lengths = _cut_shape(volume, level, brick_zyx)
    pairs = [(start, start + n) for start, n in zip(starts, lengths, strict=True)]
    return [bound for pair in reversed(pairs) for bound in pair]


def _cut_shape(volume: LocalVolume, level: int, brick_zyx: Zyx) -> Zyx:
    shape_zyx = volume.levels[level].shape_zyx
    z, y, x = (
        min(brick, size - i * brick)
        for i, brick, size in zip(brick_zyx, volume.brick_shape_zyx, shape_zyx, strict=True)
    )
    return z, y, x
