"""Fills slabs on the CPU: the fast way where a driver renders on the CPU, too."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, Any, Final

from octobrick.renderer.brick_loader import PENDING, BrickLoader
from octobrick.renderer.brick_request import BrickAddress, BrickRequest
from octobrick.renderer.brick_source import BrickSource, GradientSource
from octobrick.renderer.context import GraphicsContext
from octobrick.renderer.host_box import BoxToFill, DirectionBox, Scratch, VoxelBox
from octobrick.renderer.host_codes import HostCodes
from octobrick.renderer.slab_buffer import SlabBuffer
from octobrick.renderer.slab_filler import Filled, SlabContent
from octobrick.renderer.substitution import ancestor, nlevels_up_held
from octobrick.store.box import Box, Zyx, cells_touching

if TYPE_CHECKING:
    import moderngl

THREADS_MAX: Final = 8
BATCH_MAX: Final = 64
"""Bricks that are read before they are decoded, while a loader reads the next."""
PINNED_SHARE: Final = 4
"""The coarsest level keeps at most one part in so many of the budget."""

Held = list[tuple[Zyx, bytes | None]]


class HostFiller:
    """A `SlabFiller` with its bricks in host memory, decoded by the codec.

    Beside the budget it takes the memory of one slab's voxels, and 16 bytes for each of them where
    they are filtered.

    Args:
        context: where the textures live.
        gl: the same, current in this thread.
        budget_nbytes: host memory for compressed bricks.
        loader: reads bricks meanwhile; without one they are read when they are needed.
    """

    def __init__(
        self,
        context: GraphicsContext,  # noqa: ARG002 - as all fillers are made
        gl: moderngl.Context,  # noqa: ARG002
        budget_nbytes: int,
        loader: BrickLoader | None = None,
    ) -> None:
        self._budget_nbytes = budget_nbytes
        self._codes = HostCodes(budget_nbytes)
        self._pinned_of: tuple[object, ...] | None = None
        self._loader = loader
        self._scratch = Scratch()
        self._pool: ThreadPoolExecutor | None = None
        self.waits = True
        """Whether bricks are waited for. Else, with a loader, coarser ones stand for them."""

    def holds(self, address: BrickAddress) -> bool:
        """Whether a brick is here, or known to be absent."""
        return address in self._codes

    def fill(
        self, source: BrickSource, slab: SlabBuffer, content: SlabContent, bricks: Sequence[Zyx]
    ) -> Filled:
        """Decode the bricks, filter them if the content asks for it, and upload them."""
        if slab.holds(content, bricks):
            return Filled()
        box = VoxelBox(source, content, self._scratch)
        return self._fill(box, source, len(source.levels), slab, content, bricks)

    def fill_directions(
        self,
        gradients: GradientSource,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        """The same with codes of directions, for a slab of that format."""
        if slab.holds(content, bricks):
            return Filled()
        box = DirectionBox(content, gradients.brick_shape_zyx, self._scratch)
        return self._fill(box, gradients, max(gradients.levels) + 1, slab, content, bricks)

    @property
    def uploaded_nbytes(self) -> int:
        """Bytes of bricks taken in since the filler was made."""
        return self._codes.taken_nbytes

    @property
    def resident_nbytes(self) -> int:
        """Bytes of compressed bricks in memory."""
        return self._codes.nbytes

    @property
    def allocated_nbytes(self) -> int:
        """The same: nothing is kept for bricks to come."""
        return self._codes.nbytes

    def forget(self) -> None:
        """Let go of all bricks, of the memory for voxels and of threads. More can be filled."""
        self._codes.clear()
        self._pinned_of = None
        self._scratch.release()
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _fill(
        self,
        box: BoxToFill,
        source: Any,
        nlevels: int,
        slab: SlabBuffer,
        content: SlabContent,
        bricks: Sequence[Zyx],
    ) -> Filled:
        slab.held = None
        wanted = [zyx for zyx in bricks if box.touches(zyx)]
        try:
            if not self._may_wait and box.coarsest is not None:
                self._pin(source, box, content, box.coarsest)
            missing = self._put_all(box, source, content, wanted)
            pending = self._substitute(box, source, content, nlevels, missing)
            texels = box.texels()
        except BaseException:
            self._scratch.release()  # may hold NaN of a damaged brick
            raise
        assert slab.texture is not None
        depth, height, width = content.box.shape_zyx
        slab.texture.write(texels, viewport=(0, 0, 0, width, height, depth), alignment=1)
        slab.held, slab.held_bricks = content, frozenset(bricks) - frozenset(pending)
        return box.filled

    @property
    def _may_wait(self) -> bool:
        return self.waits or self._loader is None

    def _put_all(
        self, box: BoxToFill, source: Any, content: SlabContent, bricks: Sequence[Zyx]
    ) -> list[Zyx]:
        """Decode all bricks that are there, or come if waited for; those that are not."""
        requests = {zyx: self._request(box, source, content, zyx) for zyx in bricks}
        held = [zyx for zyx in bricks if requests[zyx].address in self._codes]
        missing = [zyx for zyx in bricks if requests[zyx].address not in self._codes]
        if self._loader is not None and missing:
            wishes = [requests[zyx] for zyx in missing]
            if self.waits:
                self._loader.urge(wishes)
            else:
                self._loader.want(wishes, keep=True)
        # First, before anything that is loaded can push them out.
        self._decode(box, [(zyx, self._codes.get(requests[zyx].address)) for zyx in held])
        pending: list[Zyx] = []
        batch: Held = []
        nbytes = 0
        for zyx in missing:
            code = self._read(requests[zyx], wait=self._may_wait)
            if code is PENDING:
                pending.append(zyx)
                continue
            size = 0 if code is None else len(code)
            if len(batch) == BATCH_MAX or nbytes + size > self._codes.room_nbytes:
                self._decode(box, batch)
                batch, nbytes = [], 0
            self._codes.put(requests[zyx].address, code)
            batch.append((zyx, code))
            nbytes += size
        self._decode(box, batch)
        return pending

    def _read(self, request: BrickRequest, *, wait: bool) -> Any:
        if self._loader is None:
            return request.read()
        return self._loader.take(request, wait=wait)

    def _request(
        self, box: BoxToFill, source: Any, content: SlabContent, zyx: Zyx, nlevels_up: int = 0
    ) -> BrickRequest:
        level = content.level + nlevels_up
        address = BrickAddress(
            content.revision, box.kind_at(level), level, content.t, content.c, zyx
        )
        return BrickRequest(address, source)

    def _substitute(
        self,
        box: BoxToFill,
        source: Any,
        content: SlabContent,
        nlevels: int,
        missing: Sequence[Zyx],
    ) -> list[Zyx]:
        """Show bricks by coarser ones, or wait for those that have none; which were shown so."""
        shown, alone = [], []
        for zyx in missing:

            def held(level: int, place: Zyx) -> bool:
                up = level - content.level
                return self._request(box, source, content, place, up).address in self._codes

            up = nlevels_up_held(zyx, content.level, nlevels, held)
            if up is None and not box.may_be_blank:
                alone.append(zyx)
                continue
            if up is None:
                box.put_coarser(zyx, 0, None)
                shown.append(zyx)
                continue
            coarser = self._request(box, source, content, ancestor(zyx, up), up)
            box.put_coarser(zyx, up, self._codes.get(coarser.address))
            shown.append(zyx)
        for zyx in alone:
            request = self._request(box, source, content, zyx)
            code = self._read(request, wait=True)
            self._codes.put(request.address, code)
            box.put(zyx, code)
        return shown

    def _pin(
        self, source: Any, box: BoxToFill, content: SlabContent, coarsest: tuple[int, Zyx]
    ) -> None:
        """Load the coarsest level, if that is new, so that there is something for every brick."""
        level, grid_zyx = coarsest
        pinned_of = (content.revision, content.t, content.c)
        if pinned_of == self._pinned_of:
            return
        self._codes.unpin()
        self._pinned_of = pinned_of
        requests = [
            self._request(box, source, content, zyx, level - content.level)
            for zyx in cells_touching(Box.of_shape(grid_zyx), (1, 1, 1))
        ]
        assert self._loader is not None
        self._loader.urge(r for r in requests if r.address not in self._codes)
        for request in requests:
            held = request.address in self._codes
            code = self._codes.get(request.address) if held else self._read(request, wait=True)
            nbytes = self._codes.pinned_nbytes + len(code or b"")
            if nbytes > self._budget_nbytes // PINNED_SHARE:
                break
            self._codes.put(request.address, code, pin=True)

    def _decode(self, box: BoxToFill, bricks: Held) -> None:
        """Put bricks into the box, several at once where that pays."""
        nthreads = min(len(os.sched_getaffinity(0)), THREADS_MAX)
        if len(bricks) < 2 or nthreads < 2:
            for zyx, code in bricks:
                box.put(zyx, code)
            return
        if self._pool is None:
            self._pool = ThreadPoolExecutor(nthreads, thread_name_prefix="octobrick-decoder")
        # In a few runs: handing over a brick costs a good part of decoding it.
        nruns = min(len(bricks), 4 * nthreads)

        def put_run(run: Held) -> None:
            for zyx, code in run:
                box.put(zyx, code)

        futures = [self._pool.submit(put_run, bricks[i::nruns]) for i in range(nruns)]
        wait(futures)
        for future in futures:
            future.result()
