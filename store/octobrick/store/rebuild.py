"""A volume's bricks made again from its source: to compare them, or to replace damaged ones."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.codec.errors import OctobrickError
from octobrick.store.box import Box, Zyx, cell_box, grid_of
from octobrick.store.brick_encoder import BrickEncoder, EncodedBrick
from octobrick.store.errors import SourceMismatchError, VolumeFormatError
from octobrick.store.piece_reader import PieceReader
from octobrick.store.progress import ProgressMeter
from octobrick.store.pyramid import REDUCERS, Layer, LevelStream
from octobrick.store.sources import Source
from octobrick.store.sources.converted import converted
from octobrick.store.sources.region import RegionSource
from octobrick.store.volume import Volume

Address = tuple[int, int, int, Zyx]
"""Level, time step, channel, brick (z, y, x)."""


def source_of(volume: Volume, source: Source) -> Source:
    """The source as the volume was made from it: the same region, type and window.

    Raises:
        SourceMismatchError: it has other voxels than the volume by shape, type or channels.
        OctobrickError: the region or conversion that the volume names do not fit the source.
    """
    made_from = volume.metadata()["source"]
    try:
        part = source
        if "region_start_zyx" in made_from:
            z, y, x = made_from["region_start_zyx"]
            region = Box((0, 0, 0), volume.levels[0].shape_zyx).shift((z, y, x))
            part = RegionSource(source, region)
        window = made_from.get("window")
        prepared = converted(part, made_from.get("stored_as"), window and tuple(window))
    except OctobrickError:
        raise
    except (TypeError, ValueError) as error:
        raise VolumeFormatError(
            f"{volume.path}: what the volume says of its source makes no sense ({error}); "
            "ingest it again",
            path=str(volume.path),
        ) from error
    for what, have, want in (
        ("shape (z, y, x)", prepared.shape_zyx, volume.levels[0].shape_zyx),
        ("sample type", prepared.dtype, volume.dtype),
        ("number of time steps", prepared.nt, volume.nt),
        ("number of channels", prepared.nc, volume.nc),
    ):
        if have != want:
            raise SourceMismatchError(
                f"{source.path}: its {what} is {have}, that of {volume.path} is {want}; give the "
                "source that the volume was made from",
                path=str(source.path),
            )
    return prepared


class Rebuild:
    """Reads a source once and encodes bricks of all levels again.

    Args:
        volume: whose options are used.
        source: what `source_of` gave.
        wanted: whether a brick is to be encoded.
        take: called with each, in order.
        replace_nonfinite: as it was when the volume was made.
    """

    def __init__(
        self,
        volume: Volume,
        source: Source,
        wanted: Callable[[Address], bool],
        take: Callable[[Address, EncodedBrick], None],
        replace_nonfinite: float | None,
    ) -> None:
        self._volume = volume
        self._source = source
        self._wanted = wanted
        self._take = take
        self._reader = PieceReader(source, replace_nonfinite)
        zstd_level = zstd_level_of(volume.path)
        self._encoders = [
            BrickEncoder(volume.level_codec(i), volume.brick_shape_zyx[0], zstd_level)
            for i in range(len(volume.levels))
        ]

    def run(self, executor: ThreadPoolExecutor, meter: ProgressMeter) -> None:
        """Go through all time steps and channels."""
        for t in range(self._source.nt):
            streams = [self._stream(t, c, executor) for c in range(self._source.nc)]
            for planes in self._reader.pieces(t, 0):
                for stream, own in zip(streams, planes, strict=True):
                    stream.push(own)
                meter.advance(planes.size, "verify")

    def _stream(self, t: int, c: int, executor: ThreadPoolExecutor) -> LevelStream:
        volume = self._volume
        shapes = tuple(level.shape_zyx for level in volume.levels)

        def emit(layer: Layer) -> None:
            _, ny, nx = grid_of(shapes[layer.level], volume.brick_shape_zyx)
            bricks = [
                (layer.index, y, x)
                for y in range(ny)
                for x in range(nx)
                if self._wanted((layer.level, t, c, (layer.index, y, x)))
            ]

            def encode(brick_zyx: Zyx) -> EncodedBrick:
                return self._encode(layer, shapes[layer.level], brick_zyx)

            for brick_zyx, encoded in zip(bricks, executor.map(encode, bricks), strict=True):
                self._take((layer.level, t, c, brick_zyx), encoded)

        reducer = REDUCERS[volume.metadata()["reducer"]]
        return LevelStream(0, shapes, volume.dtype, volume.brick_shape_zyx[0], reducer, emit)

    def _encode(self, layer: Layer, shape_zyx: Zyx, brick_zyx: Zyx) -> EncodedBrick:
        nz, (_, ny, nx) = len(layer.planes), shape_zyx
        window_box = Box((layer.first_z, 0, 0), (layer.first_z + nz, ny, nx))
        brick_box = cell_box(brick_zyx, self._volume.brick_shape_zyx)
        encoder = self._encoders[layer.level]
        return encoder.encode(layer.planes, window_box, brick_box, Box.of_shape(shape_zyx))


def zstd_level_of(path: Path) -> int:
    """The zstd level of a volume's frames, from the metadata of its first level.

    Raises:
        VolumeFormatError: it is not there.
    """
    file = path / "0" / "zarr.json"
    try:
        codecs: list[dict[str, Any]] = json.loads(file.read_bytes())["codecs"][0]["configuration"][
            "codecs"
        ]
        level = next(c["configuration"]["level"] for c in codecs if c["name"] == "zstd")
        return int(np.clip(int(level), 1, 19))
    except (OSError, ValueError, KeyError, IndexError, TypeError, StopIteration) as error:
        raise VolumeFormatError(
            f"{file}: does not say how bricks are compressed; restore it or ingest again",
            path=str(path),
        ) from error
