"""How an ingest is going to work, settled before anything is written."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from octobrick.store.box import Zyx
from octobrick.store.brick_codec import BrickCodec
from octobrick.store.brick_encoder import BrickEncoder, DirectionEncoder
from octobrick.store.ingest_options import IngestOptions
from octobrick.store.memory_plan import MemoryPlan, plan_memory
from octobrick.store.piece_reader import PieceReader
from octobrick.store.pyramid import PyramidPlan
from octobrick.store.reducers import level_shapes
from octobrick.store.sources import Source
from octobrick.store.surface.cell_encoder import CellEncoder
from octobrick.store.surface.selection import SurfaceSelection
from octobrick.store.window import Window, WindowShape, memory_window


@dataclass(frozen=True, slots=True)
class IngestPlan:
    """How an ingest is going to work.

    Attributes:
        source: whose voxels are stored as they are read.
        options: checked.
        shapes_zyx: of all levels.
        nworkers: encoding threads.
        reader: gives the source piece by piece.
        memory: what stays in memory.
        selection: the cells that are kept, where a surface is given; else None.
    """

    source: Source
    options: IngestOptions
    shapes_zyx: tuple[Zyx, ...]
    nworkers: int
    reader: PieceReader
    memory: MemoryPlan
    selection: SurfaceSelection | None = None

    @classmethod
    def of(cls, source: Source, options: IngestOptions) -> IngestPlan:
        """The plan for a source.

        Raises:
            InvalidInputError, UnsupportedError: options that do not fit it, or too little memory.
        """
        shapes = level_shapes(source.shape_zyx, options.brick, options.levels_of(source))
        options.codecs_of(source, len(shapes))
        nworkers = options.workers or len(os.sched_getaffinity(0))
        reader = PieceReader(source, options.replace_nonfinite, options.brick)
        memory = plan_memory(
            _pyramid_plan(source, options, shapes, reader, nworkers, [None] * len(shapes)),
            nt=source.nt,
            nc=source.nc,
            nworkers=nworkers,
            piece_nbytes=reader.piece_nbytes,
            limit_nbytes=options.memory_nbytes,
        )
        selection = options.selection_of(source, shapes)
        return cls(source, options, shapes, nworkers, reader, memory, selection)

    def pyramid(self, codecs: Sequence[BrickCodec], folder: Path) -> PyramidPlan:
        """What is made of each channel.

        Args:
            codecs: of each level's bricks.
            folder: for scratch files.
        """

        def make_window(array: str, shape: WindowShape) -> Window:
            return self.memory.window(folder, array, shape)

        plan = _pyramid_plan(
            self.source, self.options, self.shapes_zyx, self.reader, self.nworkers, codecs
        )
        encoder_of = (
            None if self.selection is None else partial(_cell_encoder, plan, self.selection)
        )
        return dataclasses.replace(plan, make_window=make_window, encoder_of=encoder_of)


def _cell_encoder(
    plan: PyramidPlan, selection: SurfaceSelection, level: int, brick_zyx: Zyx
) -> CellEncoder:
    encoder = plan.encoders[level]
    assert isinstance(encoder, BrickEncoder)
    return CellEncoder(encoder, selection.levels[level], brick_zyx)


def _pyramid_plan(
    source: Source,
    options: IngestOptions,
    shapes: tuple[Zyx, ...],
    reader: PieceReader,
    nworkers: int,
    codecs: Sequence[BrickCodec],
) -> PyramidPlan:
    brick = options.brick
    return PyramidPlan(
        shapes_zyx=shapes,
        dtype=source.dtype,
        encoders=[BrickEncoder(codec, brick, options.zstd_level_of(codec)) for codec in codecs],
        reducer=options.reducer_of(source),
        spacing_zyx=source.spacing_zyx,
        directions=(
            DirectionEncoder(brick, options.zstd_level_of_gradients) if options.gradients else None
        ),
        source_nplanes=reader.nplanes,
        make_window=memory_window,
        nahead=4 * nworkers,
    )
