"""Compressed bricks resident in GPU memory, the least recently used making room.

Bricks of any codec and length lie in *pages*: buffers that shaders read as 32-bit words, allocated
as they are needed up to the byte budget. A frame that needs more bricks than fit gets them in
batches, each resident until the next is asked for; so any budget works that holds a single brick.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from octobrick.codec.errors import ResourceError
from octobrick.renderer.brick_codes import BrickCodes, LevelAddress
from octobrick.renderer.free_list import FreeList
from octobrick.store.box import Zyx, ceil_div

if TYPE_CHECKING:
    import moderngl

PAGE_NBYTES_MIN: Final = 16 << 20
"""Small enough to waste little on a small volume."""
PAGE_SHARE: Final = 4
"""A new page may have this part of what is allocated: a frame then touches few pages of any pool,
and as long as that is below 256 MiB a page has at most 64."""
PAGE_NBYTES_MAX: Final = (2 << 30) - 16
"""Shaders count the bits of a page's words in what is left of 32-bit integers."""
ALIGNMENT: Final = 16
"""Of a brick's first byte, and of what it takes: it begins and ends between words."""
ABSENT_MAX: Final = 1 << 16
"""Absent bricks remembered, so that a sparse volume is not looked up anew in every frame."""

Address = tuple[LevelAddress, Zyx]


class Page:
    """A buffer, and what of it is free. The bytes of a brick lie in one piece."""

    def __init__(self, gl: moderngl.Context, nbytes: int) -> None:
        self.nbytes = nbytes
        self.buffer = gl.buffer(reserve=nbytes)
        self.free = FreeList(nbytes)


@dataclass(frozen=True, slots=True)
class Resident:
    """A brick in its place; no page where the brick is absent."""

    brick_zyx: Zyx
    page: Page | None
    offset_nbytes: int


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a brick lies, and how much of the page it takes."""

    page: Page
    offset_nbytes: int
    nbytes: int
    code_nbytes: int


class BrickPool:
    """The resident bricks of all volumes that a renderer has shown lately.

    Args:
        gl: the context, current in this thread whenever the pool is used.
        budget_nbytes: GPU memory for compressed bricks.
        page_nbytes_max: the longest buffer that a shader can read; None asks the driver.
    """

    def __init__(
        self, gl: moderngl.Context, budget_nbytes: int, page_nbytes_max: int | None = None
    ) -> None:
        self._gl = gl
        self._budget_nbytes = budget_nbytes
        limit = page_nbytes_max or int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        if limit <= 0:  # more than the 32 bits with a sign that the driver was asked for
            limit = PAGE_NBYTES_MAX
        self._page_nbytes_max = min(limit, PAGE_NBYTES_MAX) // ALIGNMENT * ALIGNMENT
        self._pages: list[Page] = []
        self._places: OrderedDict[Address, _Place] = OrderedDict()  # oldest use first
        self._absent: set[Address] = set()
        self.resident_nbytes = 0
        """Bytes of compressed bricks that are resident, without what lies between them."""
        self.uploaded_nbytes = 0
        """Since the pool was made."""

    @property
    def allocated_nbytes(self) -> int:
        """GPU memory held, never above the budget."""
        return sum(page.nbytes for page in self._pages)

    def holds(self, level: LevelAddress, zyx: Zyx) -> bool:
        """Whether a brick is resident, or known to be absent."""
        address = (level, zyx)
        return address in self._places or address in self._absent

    def keep(self, level: LevelAddress, bricks: Sequence[Zyx]) -> None:
        """Count bricks as used: others make room before them."""
        for zyx in bricks:
            if (level, zyx) in self._places:
                self._places.move_to_end((level, zyx))

    def batches(self, codes: BrickCodes, bricks: Sequence[Zyx]) -> Iterator[list[Resident]]:
        """The bricks, in batches that are resident until the next one is asked for.

        Raises:
            CorruptBrickError: what a source gave is no code of a brick.
            ResourceError: the budget does not hold a single brick.
        """
        address = {zyx: (codes.address, zyx) for zyx in bricks}
        here = [zyx for zyx in bricks if address[zyx] in self._places]
        missing = [zyx for zyx in bricks if address[zyx] not in self._places]
        if here:  # first, before anything that is loaded can push them out
            yield [self._touch(address[zyx]) for zyx in here]
        batch: list[Resident] = []
        pinned: set[Address] = set()
        for zyx in missing:
            code = self._read(codes, address[zyx])
            if code is None:
                batch.append(Resident(zyx, None, 0))
                continue
            place = self._take(len(code), pinned)
            if place is None:  # full of this batch: let the caller use it, then start anew
                if batch:
                    yield batch
                batch, pinned = [], set()
                place = self._take(len(code), pinned)
            if place is None:
                raise self._too_large(len(code))
            page, offset = place.page, place.offset_nbytes
            page.buffer.write(code.ljust(4 * ceil_div(len(code), 4), b"\0"), offset=offset)
            self.uploaded_nbytes += len(code)
            self.resident_nbytes += len(code)
            self._places[address[zyx]] = place
            pinned.add(address[zyx])
            batch.append(Resident(zyx, page, offset))
        if batch:
            yield batch

    def release(self) -> None:
        """Free all pages."""
        for page in self._pages:
            page.buffer.release()
        self._pages.clear()
        self._places.clear()
        self._absent.clear()
        self.resident_nbytes = 0

    def _touch(self, address: Address) -> Resident:
        self._places.move_to_end(address)
        place = self._places[address]
        return Resident(address[1], place.page, place.offset_nbytes)

    def _read(self, codes: BrickCodes, address: Address) -> bytes | None:
        if address in self._absent:
            return None
        code = codes.upload(address[1])
        if code is None:
            if len(self._absent) >= ABSENT_MAX:
                self._absent.clear()
            self._absent.add(address)
        return code

    def _take(self, code_nbytes: int, pinned: set[Address]) -> _Place | None:
        """Room for a brick; None where only evicting a pinned one could make it."""
        nbytes = ALIGNMENT * ceil_div(code_nbytes, ALIGNMENT)
        for page in self._pages:
            if place := self._place_in(page, nbytes, code_nbytes):
                return place
        place = self._place_in(self._room(nbytes), nbytes, code_nbytes)
        # Those of the batch were put in last: if the oldest is one of them, so are all.
        while place is None and self._places and next(iter(self._places)) not in pinned:
            place = self._place_in(self._evict_oldest(nbytes), nbytes, code_nbytes)
        return place

    @staticmethod
    def _place_in(page: Page | None, nbytes: int, code_nbytes: int) -> _Place | None:
        offset = None if page is None else page.free.take(nbytes)
        if page is None or offset is None:
            return None
        return _Place(page, offset, nbytes, code_nbytes)

    def _evict_oldest(self, nbytes: int) -> Page | None:
        """Give up a brick; a page that may have room for another now."""
        _, place = self._places.popitem(last=False)
        page = place.page
        self.resident_nbytes -= place.code_nbytes
        page.free.give_back(place.offset_nbytes, place.nbytes)
        if not page.free.is_empty or page.nbytes >= nbytes:
            return page
        self._pages.remove(page)  # empty, and yet too small: room for another
        page.buffer.release()
        return self._room(nbytes)

    def _room(self, nbytes: int) -> Page | None:
        """A new page that holds a brick, where the budget has room for it."""
        allocated = self.allocated_nbytes
        wanted = max(PAGE_NBYTES_MIN, allocated // PAGE_SHARE, nbytes)
        size = min(wanted, self._budget_nbytes - allocated, self._page_nbytes_max)
        size = size // ALIGNMENT * ALIGNMENT
        if size < nbytes:
            return None
        page = Page(self._gl, size)
        self._pages.append(page)
        return page

    def _too_large(self, nbytes: int) -> ResourceError:
        if ALIGNMENT * ceil_div(nbytes, ALIGNMENT) > self._page_nbytes_max:
            return ResourceError(
                f"a brick takes {nbytes} bytes, more than the {self._page_nbytes_max} bytes that "
                "this driver's shaders can read in one piece; ingest the volume with smaller "
                "bricks",
                brick_nbytes=nbytes,
                page_nbytes_max=self._page_nbytes_max,
            )
        return ResourceError(
            f"a brick takes {nbytes} bytes, more than the {self._budget_nbytes} bytes kept for "
            "bricks; raise memory_budget",
            brick_nbytes=nbytes,
            budget_nbytes=self._budget_nbytes,
        )
