"""Compressed bricks resident in GPU textures, the least recently used making room.

Bricks of one layout share *pages*: sets of textures with a grid of slots, allocated as they are
needed up to the byte budget. A frame that needs more bricks than fit gets them in batches, each
resident until the next is asked for; so any budget works that holds a single brick.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from octobrick.codec.errors import CorruptBrickError, ResourceError
from octobrick.renderer.brick_source import BrickSource
from octobrick.renderer.code_layout import CodeLayout, TexelsXyz
from octobrick.store.box import Zyx

if TYPE_CHECKING:
    import moderngl

PAGE_NBYTES: Final = 16 << 20
"""Large enough that a frame touches few pages, small enough to waste little on a small volume."""
PAGE_SIDE_TEXELS: Final = 2048
"""Every driver of OpenGL 4.5 allows at least this along each side of a 3D texture."""
PAGE_SIDE_SLOTS: Final = 8
"""Slots along a page's x and y: bricks of up to 256 voxels, the largest there are, fit."""
ABSENT_MAX: Final = 1 << 16
"""Absent bricks remembered, so that a sparse volume is not looked up anew in every frame."""

Address = tuple[str, int, int, int, Zyx]
"""(revision, level, t, c, brick): never changes its bytes."""


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Textures of one layout, each with the same grid of slots."""

    layout: CodeLayout
    slots_xyz: TexelsXyz
    textures: tuple[moderngl.Texture3D, ...]
    free: list[int] = field(default_factory=list)

    @property
    def nslots(self) -> int:
        """Bricks that the page holds."""
        x, y, z = self.slots_xyz
        return x * y * z

    @property
    def nbytes(self) -> int:
        """GPU memory of the page."""
        return self.nslots * self.layout.code_nbytes

    def texel_of(self, slot: int, part: int) -> TexelsXyz:
        """The first texel of a slot in the texture of one part."""
        nx, ny, _ = self.slots_xyz
        x, y, z = self.layout.parts[part].texels_xyz
        return (slot % nx * x, slot // nx % ny * y, slot // (nx * ny) * z)

    def write(self, slot: int, code: bytes) -> None:
        """Upload a brick's bytes as they are."""
        at = 0
        for i, (part, texture) in enumerate(zip(self.layout.parts, self.textures, strict=True)):
            piece = memoryview(code)[at : at + part.nbytes]
            texture.write(piece, viewport=(*self.texel_of(slot, i), *part.texels_xyz))
            at += part.nbytes

    def release(self) -> None:
        """Free the textures."""
        for texture in self.textures:
            texture.release()


@dataclass(frozen=True, slots=True)
class Resident:
    """A brick in its slot; no page where the brick is absent."""

    brick_zyx: Zyx
    page: Page | None
    slot: int


class BrickPool:
    """The resident bricks of all volumes that a renderer has shown lately.

    Args:
        gl: the context, current in this thread whenever the pool is used.
        budget_nbytes: GPU memory for compressed bricks.
    """

    def __init__(self, gl: moderngl.Context, budget_nbytes: int) -> None:
        self._gl = gl
        self._budget_nbytes = budget_nbytes
        self._pages: list[Page] = []
        self._slots: OrderedDict[Address, tuple[Page, int]] = OrderedDict()  # oldest use first
        self._absent: set[Address] = set()
        self.uploaded_nbytes = 0
        """Since the pool was made."""

    @property
    def resident_nbytes(self) -> int:
        """Bytes of compressed bricks that are resident, without empty slots."""
        return sum(page.layout.code_nbytes for page, _ in self._slots.values())

    @property
    def allocated_nbytes(self) -> int:
        """GPU memory held, never above the budget."""
        return sum(page.nbytes for page in self._pages)

    def batches(
        self, source: BrickSource, level: int, t: int, c: int, bricks: Sequence[Zyx]
    ) -> Iterator[list[Resident]]:
        """The bricks, in batches that are resident until the next one is asked for.

        Raises:
            CorruptBrickError: the source gave a brick of the wrong length.
            ResourceError: the budget does not hold a single brick.
        """
        layout = CodeLayout.of(source, level)
        address = {zyx: (source.revision, level, t, c, zyx) for zyx in bricks}
        here = [zyx for zyx in bricks if address[zyx] in self._slots]
        missing = [zyx for zyx in bricks if address[zyx] not in self._slots]
        if here:  # first, before anything that is loaded can push them out
            yield [self._touch(address[zyx]) for zyx in here]
        batch: list[Resident] = []
        pinned: set[Address] = set()
        for zyx in missing:
            code = self._read(source, address[zyx], layout)
            if code is None:
                batch.append(Resident(zyx, None, 0))
                continue
            place = self._take_slot(layout, pinned)
            if place is None:  # full of this batch: let the caller use it, then start anew
                yield batch
                batch, pinned = [], set()
                place = self._take_slot(layout, pinned)
            if place is None:
                raise ResourceError(
                    f"a brick takes {layout.code_nbytes} bytes, more than the "
                    f"{self._budget_nbytes} bytes kept for bricks; raise memory_budget",
                    brick_nbytes=layout.code_nbytes,
                    budget_nbytes=self._budget_nbytes,
                )
            page, slot = place
            page.write(slot, code)
            self.uploaded_nbytes += len(code)
            self._slots[address[zyx]] = place
            pinned.add(address[zyx])
            batch.append(Resident(zyx, page, slot))
        if batch:
            yield batch

    def release(self) -> None:
        """Free all textures."""
        for page in self._pages:
            page.release()
        self._pages.clear()
        self._slots.clear()
        self._absent.clear()

    def _touch(self, address: Address) -> Resident:
        self._slots.move_to_end(address)
        page, slot = self._slots[address]
        return Resident(address[4], page, slot)

    def _read(self, source: BrickSource, address: Address, layout: CodeLayout) -> bytes | None:
        if address in self._absent:
            return None
        _, level, t, c, zyx = address
        code = source.brick_code(level, zyx, t, c)
        if code is None:
            if len(self._absent) >= ABSENT_MAX:
                self._absent.clear()
            self._absent.add(address)
            return None
        if len(code) != layout.code_nbytes:
            raise CorruptBrickError(
                f"brick {zyx} of level {level}: {len(code)} bytes of code, expected "
                f"{layout.code_nbytes} for {layout.dtype} bricks of {layout.brick_zyx}; fetch it "
                "again or re-ingest the volume",
                level=level,
                brick_zyx=list(zyx),
                nbytes=len(code),
                expected_nbytes=layout.code_nbytes,
            )
        return code

    def _take_slot(self, layout: CodeLayout, pinned: set[Address]) -> tuple[Page, int] | None:
        """A slot to write to; None where only evicting a pinned brick could make one."""
        for page in self._pages:
            if page.layout == layout and page.free:
                return page, page.free.pop()
        room = self._budget_nbytes - self.allocated_nbytes
        while room < layout.code_nbytes and self._drop_page_of_other_layout(layout):
            room = self._budget_nbytes - self.allocated_nbytes
        if room >= layout.code_nbytes:
            page = self._allocate(layout, min(room, PAGE_NBYTES))
            return page, page.free.pop()
        for address, (page, slot) in self._slots.items():
            if page.layout == layout and address not in pinned:
                del self._slots[address]
                return page, slot
        return None

    def _drop_page_of_other_layout(self, layout: CodeLayout) -> bool:
        """Give up a page of another layout, that with the longest unused brick; False if none."""
        others = [page for page in self._pages if page.layout != layout]
        if not others:
            return False
        oldest = next((p for p, _ in self._slots.values() if p.layout != layout), others[0])
        for address in [a for a, (page, _) in self._slots.items() if page is oldest]:
            del self._slots[address]
        self._pages.remove(oldest)
        oldest.release()
        return True

    def _allocate(self, layout: CodeLayout, nbytes: int) -> Page:
        n, side = max(nbytes // layout.code_nbytes, 1), PAGE_SIDE_SLOTS
        deepest = max(PAGE_SIDE_TEXELS // layout.brick_zyx[0], 1)
        slots_xyz = (
            min(n, side),
            min(max(n // side, 1), side),
            min(max(n // side**2, 1), deepest),
        )
        textures = tuple(
            self._gl.texture3d(
                (slots_xyz[0] * x, slots_xyz[1] * y, slots_xyz[2] * z),
                part.components,
                dtype=part.gl_dtype,
            )
            for part in layout.parts
            for x, y, z in [part.texels_xyz]
        )
        for texture in textures:  # integer textures are incomplete with any other filter
            texture.filter = (self._gl.NEAREST, self._gl.NEAREST)
        page = Page(layout, slots_xyz, textures)
        page.free.extend(reversed(range(page.nslots)))
        self._pages.append(page)
        return page
