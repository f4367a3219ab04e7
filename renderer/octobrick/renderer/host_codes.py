"""Compressed bricks in host memory, the least recently used making room. No GL."""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from octobrick.codec.errors import ResourceError
from octobrick.renderer.brick_request import BrickAddress

ABSENT_MAX: Final = 1 << 16
"""Absent bricks remembered, so that a sparse volume is not looked up anew in every frame."""


class HostCodes:
    """Codes of bricks by their address, never more than a budget.

    Args:
        budget_nbytes: for the bytes of all codes together.
    """

    def __init__(self, budget_nbytes: int) -> None:
        self._budget_nbytes = budget_nbytes
        self._codes: OrderedDict[BrickAddress, bytes] = OrderedDict()  # oldest use first
        self._pinned: dict[BrickAddress, bytes] = {}
        self._absent: set[BrickAddress] = set()
        self.nbytes = 0
        """Of the codes that are held."""
        self.pinned_nbytes = 0
        """Of those that do not make room for others."""
        self.taken_nbytes = 0
        """Of all that were put here, ever."""

    def __contains__(self, address: BrickAddress) -> bool:
        return address in self._codes or address in self._pinned or address in self._absent

    def get(self, address: BrickAddress) -> bytes | None:
        """A brick that is held, now the latest in use; None where it is absent.

        Raises:
            KeyError: it is not held.
        """
        if address in self._absent:
            return None
        if address in self._pinned:
            return self._pinned[address]
        self._codes.move_to_end(address)
        return self._codes[address]

    def put(self, address: BrickAddress, code: bytes | None, *, pin: bool = False) -> None:
        """Hold a brick, in place of those that have not been used for longest.

        Raises:
            ResourceError: the budget does not hold this brick.
        """
        if pin and address in self._codes:
            self.nbytes -= len(self._codes.pop(address))
        if address in self:
            return
        if code is None:
            if len(self._absent) >= ABSENT_MAX:
                self._absent.clear()
            self._absent.add(address)
            return
        room = self._budget_nbytes - self.pinned_nbytes
        if len(code) > room:
            raise ResourceError(
                f"a brick takes {len(code)} bytes, more than the {room} bytes kept for bricks; "
                "raise memory_budget",
                brick_nbytes=len(code),
                budget_nbytes=self._budget_nbytes,
            )
        while self.nbytes + len(code) > self._budget_nbytes:
            _, dropped = self._codes.popitem(last=False)
            self.nbytes -= len(dropped)
        self.nbytes += len(code)
        self.taken_nbytes += len(code)
        if pin:
            self._pinned[address] = code
            self.pinned_nbytes += len(code)
        else:
            self._codes[address] = code

    @property
    def room_nbytes(self) -> int:
        """What can be held beside the pinned bricks."""
        return self._budget_nbytes - self.pinned_nbytes

    def unpin(self) -> None:
        """Let pinned bricks make room for others again."""
        self._codes.update(self._pinned)
        self._pinned.clear()
        self.pinned_nbytes = 0

    def clear(self) -> None:
        """Let go of all bricks."""
        self._codes.clear()
        self._pinned.clear()
        self._absent.clear()
        self.nbytes = self.pinned_nbytes = 0
