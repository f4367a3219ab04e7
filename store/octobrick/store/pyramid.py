"""The pyramid as a stream: rows of level 0 go in, encoded bricks of all levels come out, in order.

Each level holds a layer of bricks and a plane on either side, so memory is bounded by a slab of
the volume (4/3 of it over all levels), never by the volume; where a slab is too much, windows lie
in scratch files, and memory is bounded by a row of bricks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from octobrick.codec import metrics
from octobrick.store.box import Box, Zyx, ceil_div, grid_of
from octobrick.store.brick_encoder import DirectionCodes, DirectionEncoder, EncodedBrick
from octobrick.store.brick_work import BrickResult, BrickWork, Encoder
from octobrick.store.gradient_pyramid import GradientPyramid, gradient_array
from octobrick.store.in_order import in_order
from octobrick.store.piece_reader import Piece
from octobrick.store.reducers import REDUCERS
from octobrick.store.window import MakeWindow, Window, WindowShape

Voxels = NDArray[np.generic]


class Address(NamedTuple):
    """A brick of a volume: of which array ("0", "gradient/1", …), time step and channel."""

    array: str
    t: int
    c: int
    zyx: Zyx


class Sink(Protocol):
    """Where bricks go, in order: arrays' layers as they are completed, z slowest, x fastest."""

    def wants(self, address: Address) -> bool:
        """Whether this brick is to be encoded."""

    def take(self, address: Address, encoded: EncodedBrick) -> None:
        """Store, or compare, a brick that was wanted."""

    def count(self, t: int, c: int, histogram: metrics.Histogram) -> None:
        """Add up the values of bricks of level 0."""

    def end_layer(self, array: str, t: int, c: int, index: int) -> None:
        """All bricks of a layer have been given."""


@dataclass(frozen=True, slots=True)
class PyramidPlan:
    """What is made of each channel of each time step.

    Attributes:
        shapes_zyx: of all levels.
        dtype: sample type.
        encoders: of each level's bricks.
        reducer: one of `REDUCERS`.
        spacing_zyx: world size of a voxel of level 0.
        directions: encodes gradients; None where there are none.
        source_nplanes: so many planes of level 0 are put at once, at most.
        make_window: of an array.
        nahead: bricks that may be under way at once.
        encoder_of: of a level and a brick, where bricks have their own; else None.
    """

    shapes_zyx: tuple[Zyx, ...]
    dtype: np.dtype[np.generic]
    encoders: Sequence[Encoder]
    reducer: str
    spacing_zyx: tuple[float, float, float]
    directions: DirectionEncoder | None
    source_nplanes: int
    make_window: MakeWindow
    nahead: int
    encoder_of: Callable[[int, Zyx], Encoder] | None = None

    @property
    def brick(self) -> int:
        """Voxels per brick and axis."""
        return self.encoders[0].brick

    @property
    def nlocal_gradients(self) -> int:
        """How many levels of gradients can be made from a brick of level 0 alone."""
        if self.directions is None:
            return 0
        halvings = (self.brick & -self.brick).bit_length() - 1
        return min(halvings, len(self.shapes_zyx) - 1)

    def work(self, level: int) -> BrickWork:
        """What is to be done with the bricks of a level."""
        is_coarsest = level + 1 == len(self.shapes_zyx)
        return BrickWork(
            encoder=self.encoders[level],
            reducer=None if is_coarsest else REDUCERS[self.reducer],
            has_histogram=level == 0,
            spacing_zyx=self.spacing_zyx,
            ngradients=self.nlocal_gradients if level == 0 else 0,
        )

    def window_shapes(self) -> dict[str, WindowShape]:
        """Of the windows of all arrays, by their paths."""
        shapes = {}
        for level, (nz, ny, nx) in enumerate(self.shapes_zyx):
            # A layer takes a plane on either side; beyond may be whatever is put at once.
            # Pieces of the source are kept whole, the first and the last too.
            nput = 2 * self.source_nplanes if level == 0 else self.brick // 2
            nplanes = min(nz, self.brick + 1 + nput)
            shapes[str(level)] = WindowShape(nplanes, (ny, nx), self.dtype)
            if level and self.directions is not None:
                nplanes, dtype = min(nz, self.brick), np.dtype(np.uint8)
                shapes[gradient_array(level)] = WindowShape(nplanes, (ny, nx, 3), dtype)
        return shapes

    def windows(self) -> dict[str, Window]:
        """New windows of all arrays."""
        return {
            array: self.make_window(array, shape) for array, shape in self.window_shapes().items()
        }


class Held(NamedTuple):
    """The state of one level: its next layer, and the window whose complete planes it holds."""

    layer: int
    window: Window


class Pyramid:
    """All levels of one channel of one time step.

    Args:
        plan: what is made.
        t: the time step.
        c: the channel.
        executor: works on bricks.
        sink: where they go. Neither the number of workers nor their timing changes the order.
    """

    def __init__(self, plan: PyramidPlan, t: int, c: int, executor: Executor, sink: Sink) -> None:
        windows = plan.windows()
        self.gradients = (
            None
            if plan.directions is None
            else GradientPyramid(
                plan.shapes_zyx,
                plan.nlocal_gradients,
                plan.brick,
                windows,
                partial(_encode_directions, plan, t, c, executor, sink),
            )
        )
        level: _Level | None = None
        for index in reversed(range(len(plan.shapes_zyx))):
            level = _Level(
                plan, index, windows[str(index)], t, c, executor, sink, level, self.gradients
            )
        assert level is not None
        self._finest = level

    def put(self, z: int, y: int, rows: Voxels) -> None:
        """Take rows of level 0, in any order within what the plan says is put at once."""
        self._finest.window.put(z, y, rows)

    def complete_to(self, z: int) -> None:
        """All rows before plane ``z`` have been put: do what can be done with them."""
        self._finest.complete_to(z)

    @property
    def nlayers_done(self) -> int:
        """How many layers of bricks of level 0 are done."""
        return self._finest.layer

    def held(self) -> list[Held]:
        """What each level has not done yet, or still needs."""
        return [Held(level.layer, level.window) for level in self._levels()]

    def restore(self, layers: Sequence[int]) -> None:
        """Go on at these layers of each level, whose windows have been filled."""
        for level, layer in zip(self._levels(), layers, strict=True):
            level.layer = layer

    def _levels(self) -> Iterator[_Level]:
        level: _Level | None = self._finest
        while level is not None:
            yield level
            level = level.coarser


def feed(pyramids: Sequence[Pyramid], piece: Piece) -> None:
    """Give a piece of the source to the pyramids of its channels."""
    for pyramid, own in zip(pyramids, piece.voxels, strict=True):
        pyramid.put(piece.z, piece.y, own)
        pyramid.complete_to(piece.stop_z)


class _Span(NamedTuple):
    """A brick along one axis: with a voxel around it, in the level; without, in those."""

    around: tuple[int, int]
    core: tuple[int, int]


class _Level:
    """Gathers the rows of one level into layers, works on their bricks and feeds the next."""

    def __init__(
        self,
        plan: PyramidPlan,
        index: int,
        window: Window,
        t: int,
        c: int,
        executor: Executor,
        sink: Sink,
        coarser: _Level | None,
        gradients: GradientPyramid | None,
    ) -> None:
        self.coarser = coarser
        self.window = window
        self.layer = 0
        self._plan, self._index, self._t, self._c = plan, index, t, c
        self._executor, self._sink = executor, sink
        self._gradients = gradients if index == 0 else None
        self._work = plan.work(index)
        self._shape_zyx = plan.shapes_zyx[index]

    def complete_to(self, z: int) -> None:
        """Work on every layer that planes before ``z`` make complete."""
        self.window.complete_to(z)
        nz, brick = self._shape_zyx[0], self._plan.brick
        while self.layer * brick < nz:
            stop_z = min((self.layer + 1) * brick, nz)
            if z < min(stop_z + 1, nz):
                return
            self._work_on_layer()
            self._sink.end_layer(str(self._index), self._t, self._c, self.layer)
            self.layer += 1
            self.window.drop_to(stop_z - 1)
            if self.coarser is not None:
                self.coarser.complete_to(ceil_div(stop_z, 2))
            if self._gradients is not None:
                self._gradients.complete_to(stop_z)

    def _work_on_layer(self) -> None:
        _, ny, nx = grid_of(self._shape_zyx, (self._plan.brick,) * 3)
        results = in_order(self._executor, self._calls(ny, nx), self._plan.nahead)
        for y in range(ny):
            self._give(y, [next(results) for _ in range(nx)])

    def _calls(self, ny: int, nx: int) -> Iterator[Callable[[], BrickResult]]:
        z_span = self._span(self.layer, 0)
        x_spans = [self._span(x, 2) for x in range(nx)]
        for y in range(ny):
            y_span = self._span(y, 1)
            rows = self.window.rows(*z_span.around, *y_span.around)
            for x, x_span in enumerate(x_spans):
                around = partial(rows, *x_span.around)
                starts, stops = zip(z_span.core, y_span.core, x_span.core, strict=True)
                is_wanted = self._sink.wants(self._address((self.layer, y, x)))
                work = self._work_on((self.layer, y, x))
                yield partial(work.run, around, Box(starts, stops), is_wanted=is_wanted)

    def _work_on(self, brick_zyx: Zyx) -> BrickWork:
        if self._plan.encoder_of is None:
            return self._work
        return replace(self._work, encoder=self._plan.encoder_of(self._index, brick_zyx))

    def _span(self, index: int, axis: int) -> _Span:
        """Where the bricks with this index lie along an axis."""
        n, brick = self._shape_zyx[axis], self._plan.brick
        start, stop = index * brick, min((index + 1) * brick, n)
        first = max(start - 1, 0)
        return _Span((first, min(stop + 1, n)), (start - first, stop - first))

    def _give(self, y: int, row: list[BrickResult]) -> None:
        """Hand a row of bricks to the sink and, at half resolution, to the coarser level."""
        for x, result in enumerate(row):
            if result.encoded is not None:
                self._sink.take(self._address((self.layer, y, x)), result.encoded)
        counted = [r.histogram for r in row if r.histogram is not None]
        if counted:
            self._sink.count(self._t, self._c, metrics.Histogram.total_of(counted))
        half = self._plan.brick // 2
        if self.coarser is not None:
            blocks = [r.coarser for r in row if r.coarser is not None]
            self.coarser.window.put_blocks(self.layer * half, y * half, blocks)
        if self._gradients is not None:
            self._gradients.put(self.layer, y, row)

    def _address(self, brick_zyx: Zyx) -> Address:
        return Address(str(self._index), self._t, self._c, brick_zyx)


def _encode_directions(
    plan: PyramidPlan,
    t: int,
    c: int,
    executor: Executor,
    sink: Sink,
    level: int,
    layer: int,
    window: Window,
) -> None:
    """Encode a layer of bricks of gradients, all of whose planes are in their window."""
    directions = plan.directions
    assert directions is not None
    array, brick = gradient_array(level), plan.brick
    nz, ny, nx = plan.shapes_zyx[level]
    _, rows, columns = grid_of(plan.shapes_zyx[level], (brick,) * 3)

    def calls() -> Iterator[Callable[[], EncodedBrick | None]]:
        for y in range(rows):
            stop_z, stop_y = min((layer + 1) * brick, nz), min((y + 1) * brick, ny)
            codes = window.rows(layer * brick, stop_z, y * brick, stop_y)
            for x in range(columns):
                own = partial(codes, x * brick, min((x + 1) * brick, nx))
                is_wanted = sink.wants(Address(array, t, c, (layer, y, x)))
                yield partial(_encoded, directions, own) if is_wanted else _nothing

    results = in_order(executor, calls(), plan.nahead)
    for y in range(rows):
        for x in range(columns):
            encoded = next(results)
            if encoded is not None:
                sink.take(Address(array, t, c, (layer, y, x)), encoded)
    sink.end_layer(array, t, c, layer)


def _encoded(encoder: DirectionEncoder, codes: Callable[[], DirectionCodes]) -> EncodedBrick:
    return encoder.encode(codes())


def _nothing() -> None:
    return None
