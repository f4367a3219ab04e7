"""A volume's bricks made again from its source: to compare them, or to replace damaged ones."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from octobrick.codec.errors import OctobrickError, UnsupportedError
from octobrick.store.box import Box
from octobrick.store.brick_encoder import BrickEncoder, DirectionEncoder
from octobrick.store.camera_grid import CameraGrid
from octobrick.store.errors import SourceMismatchError, VolumeFormatError
from octobrick.store.gradient_pyramid import gradient_array
from octobrick.store.local_volume import LocalVolume
from octobrick.store.memory_plan import plan_memory
from octobrick.store.piece_reader import PieceReader
from octobrick.store.progress import ProgressMeter
from octobrick.store.pyramid import Pyramid, PyramidPlan, Sink, feed
from octobrick.store.sources import Source
from octobrick.store.sources.converted import converted
from octobrick.store.sources.region import RegionSource
from octobrick.store.window import memory_window


def source_of(volume: LocalVolume, source: Source) -> Source:
    """The source as the volume was made from it: the same region, type and window.

    Raises:
        SourceMismatchError: it has other voxels than the volume by shape, type or channels.
        UnsupportedError: the volume holds only what a surface touches.
        OctobrickError: the region or conversion that the volume names do not fit the source.
    """
    if volume.surface is not None:
        raise UnsupportedError(
            f"{volume.path}: holds the cells around {volume.surface.name} only, which its source "
            "does not tell; verify it without the source, or ingest it again",
            path=str(volume.path),
        )
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
        ("light field", _views(prepared.light_field), _views(volume.light_field)),
    ):
        if have != want:
            raise SourceMismatchError(
                f"{source.path}: its {what} is {have}, that of {volume.path} is {want}; give the "
                "source that the volume was made from",
                path=str(source.path),
            )
    return prepared


def _views(grid: CameraGrid | None) -> str:
    return "none" if grid is None else f"{grid.nu} × {grid.nv} views"


class Rebuild:
    """Reads a source once and encodes bricks of all levels again.

    Args:
        volume: whose options are used.
        source: what `source_of` gave.
        sink: says which bricks it wants, and takes them.
        replace_nonfinite: as it was when the volume was made.
        nworkers: threads that encode.
    """

    def __init__(
        self,
        volume: LocalVolume,
        source: Source,
        sink: Sink,
        replace_nonfinite: float | None,
        nworkers: int,
    ) -> None:
        self._source = source
        self._sink = sink
        self._nworkers = nworkers
        brick = volume.brick_shape_zyx[0]
        self._reader = PieceReader(source, replace_nonfinite, brick)
        shapes = tuple(level.shape_zyx for level in volume.levels)
        plan = PyramidPlan(
            shapes_zyx=shapes,
            dtype=volume.dtype,
            encoders=[
                BrickEncoder(volume.level_codec(i), brick, zstd_level_of(volume.path, str(i)))
                for i in range(len(shapes))
            ],
            reducer=volume.metadata()["reducer"],
            spacing_zyx=tuple(volume.metadata()["spacing"]),  # as it was, whatever was said of it
            directions=_direction_encoder(volume),
            source_nplanes=self._reader.nplanes,
            make_window=memory_window,
            nahead=4 * nworkers,
        )
        memory = plan_memory(
            plan,
            nt=source.nt,
            nc=source.nc,
            nworkers=nworkers,
            piece_nbytes=self._reader.piece_nbytes,
            limit_nbytes=None,
        )
        # The volume's folder may be read-only.
        make_window = partial(memory.window, Path(tempfile.gettempdir()))
        self._plan = dataclasses.replace(plan, make_window=make_window)

    def run(self, meter: ProgressMeter) -> None:
        """Go through all time steps and channels."""
        with ThreadPoolExecutor(self._nworkers, thread_name_prefix="octobrick-encode") as executor:
            for t in range(self._source.nt):
                pyramids = [
                    Pyramid(self._plan, t, c, executor, self._sink) for c in range(self._source.nc)
                ]
                for piece in self._reader.pieces(t, 0):
                    feed(pyramids, piece)
                    meter.advance(piece.voxels.size, "verify")


def _direction_encoder(volume: LocalVolume) -> DirectionEncoder | None:
    if volume.gradients is None:
        return None
    zstd_level = zstd_level_of(volume.path, gradient_array(volume.gradients.levels[0]))
    return DirectionEncoder(volume.brick_shape_zyx[0], zstd_level)


def zstd_level_of(path: Path, array: str) -> int:
    """The zstd level of the frames of one of a volume's arrays, from its metadata.

    Raises:
        VolumeFormatError: it is not there.
    """
    file = path / array / "zarr.json"
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
