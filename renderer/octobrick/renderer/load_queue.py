"""What to read next, and what has been read but not taken: plain values, no threads.

A brick that has been read is *wanted* by the present view, was read *ahead* for views to come, or
is *stale*: nobody asks for it any more. Stale ones make room for others, those read ahead for
wanted ones, the oldest first. Nothing is read that would then have no room.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from octobrick.renderer.brick_request import BrickAddress, BrickRequest

ENTRY_NBYTES: Final = 128
"""What a brick that was read counts beside its bytes: absent ones and errors take memory, too."""


class Rank(IntEnum):
    """Who asks for a brick; the lower makes room for the higher."""

    STALE = 0
    AHEAD = 1
    WANTED = 2


@dataclass(slots=True)
class Outcome:
    """What reading gave: bytes, None for an absent brick, or an error."""

    code: bytes | None = None
    error: Exception | None = None

    @property
    def nbytes(self) -> int:
        """Memory that it takes."""
        return ENTRY_NBYTES + (len(self.code) if self.code is not None else 0)

    def result(self) -> bytes | None:
        """The bytes; raises the error that came instead."""
        if self.error is not None:
            raise self.error
        return self.code


@dataclass(slots=True)
class _Ready:
    outcome: Outcome
    rank: Rank
    was_ahead: bool


class LoadQueue:
    """The wishes of a view and of views to come, and what is at hand for them.

    Args:
        budget_nbytes: for what has been read and not taken, what is being read included.
    """

    def __init__(self, budget_nbytes: int) -> None:
        self._budget_nbytes = budget_nbytes
        self._wanted: dict[BrickAddress, BrickRequest] = {}  # most urgent first
        self._ahead: dict[BrickAddress, BrickRequest] = {}
        self._ranks: dict[BrickAddress, Rank] = {}  # of all wishes, met or not
        self._ready: OrderedDict[BrickAddress, _Ready] = OrderedDict()  # oldest first
        self._under_way: dict[BrickAddress, bool] = {}  # whether it is for the queue
        self._awaited: dict[BrickAddress, int] = {}
        self._urged: tuple[BrickAddress, ...] = ()  # last; stay before what is given back
        self._largest_nbytes = ENTRY_NBYTES
        self.nbytes = 0
        """Of what was read and not taken."""
        self.ncancelled = 0
        self.nhits_ahead = 0

    @property
    def idle(self) -> bool:
        """Whether nothing wanted is left to read or under way."""
        return not self._wanted and not self._under_way

    def want(self, requests: Iterable[BrickRequest], *, keep: bool = False) -> None:
        """The wishes of a new view, most urgent first, instead of those of the one before.

        Args:
            keep: of the same view, behind those that it has already.
        """
        wishes = {r.address: r for r in requests}
        if keep:
            self._ranks.update(dict.fromkeys(wishes, Rank.WANTED))
            self._rank_ready()
            self._wanted |= {a: r for a, r in self._unread(wishes).items() if a not in self._wanted}
        else:
            self.ncancelled += sum(address not in wishes for address in self._wanted)
            self._demote(Rank.WANTED, wishes)
            self._wanted = self._unread(wishes)
            self._urged = ()
        for address in self._wanted:
            self._ahead.pop(address, None)

    def urge(self, requests: Iterable[BrickRequest]) -> None:
        """Put requests before all others."""
        wishes = {r.address: r for r in requests}
        self._ranks.update(dict.fromkeys(wishes, Rank.WANTED))
        self._rank_ready()
        first = self._unread(wishes)
        self._urged = tuple(first)
        self._wanted = first | {a: r for a, r in self._wanted.items() if a not in first}
        for address in first:
            self._ahead.pop(address, None)

    def prefetch(self, requests: Iterable[BrickRequest]) -> None:
        """What views to come may want, most likely first, instead of what was thought before."""
        wishes = {r.address: r for r in requests if self._ranks.get(r.address) != Rank.WANTED}
        self._demote(Rank.AHEAD, wishes)
        self._ahead = self._unread(wishes)

    def begin(self, may: Callable[[BrickRequest], bool] | None = None) -> BrickRequest | None:
        """The next to be read, now under way; None where nothing is left or has room.

        Args:
            may: whether a request may be begun; the next that may is taken.
        """
        wishes, rank = (self._wanted, Rank.WANTED) if self._wanted else (self._ahead, Rank.AHEAD)
        request = next((r for r in wishes.values() if may is None or may(r)), None)
        nunder_way = sum(self._under_way.values())
        if request is None or not self._make_room((nunder_way + 1) * self._largest_nbytes, rank):
            return None
        del wishes[request.address]
        self._under_way[request.address] = True
        return request

    def begin_like(
        self, first: BrickRequest, count_max: int, alike: Callable[[BrickRequest], bool]
    ) -> list[BrickRequest]:
        """What can be read together with a request that was begun, most urgent first, itself too.

        Args:
            first: begun already.
            count_max: of all of them.
            alike: whether a request can be read with it.
        """
        begun = [first]
        wishes, rank = (self._wanted, Rank.WANTED) if self._wanted else (self._ahead, Rank.AHEAD)
        for request in [r for r in wishes.values() if alike(r)][: count_max - 1]:
            nunder_way = sum(self._under_way.values())
            if not self._make_room((nunder_way + 1) * self._largest_nbytes, rank):
                break
            begun.append(wishes.pop(request.address))
            self._under_way[request.address] = True
        return begun

    def give_back(self, requests: Iterable[BrickRequest]) -> None:
        """What was under way is not read after all: wished for as before, before all others."""
        wanted: dict[BrickAddress, BrickRequest] = {}
        ahead: dict[BrickAddress, BrickRequest] = {}
        for request in requests:
            address = request.address
            del self._under_way[address]
            match self._ranks.get(address, Rank.STALE):
                case Rank.WANTED:
                    wanted[address] = request
                case Rank.AHEAD:
                    ahead[address] = request
                case _:
                    self.ncancelled += 1
        first = {a: self._wanted[a] for a in self._urged if a in self._wanted}
        self._wanted = first | wanted | self._wanted
        self._ahead = ahead | self._ahead

    def is_wanted(self, address: BrickAddress) -> bool:
        """Whether the present view wants it, read or not."""
        return self._ranks.get(address) == Rank.WANTED

    def is_unread(self, address: BrickAddress) -> bool:
        """Whether it is wished for, and nobody reads it yet."""
        return address in self._wanted or address in self._ahead

    def end(self, address: BrickAddress, outcome: Outcome) -> None:
        """What was under way has been read: kept if it fits, or if somebody waits for it."""
        del self._under_way[address]
        self._largest_nbytes = max(self._largest_nbytes, outcome.nbytes)
        rank = self._ranks.get(address, Rank.STALE)
        if self._make_room(outcome.nbytes, rank) or address in self._awaited:
            self._ready[address] = _Ready(outcome, rank, rank == Rank.AHEAD)
            self.nbytes += outcome.nbytes

    def take(self, address: BrickAddress) -> Outcome | None:
        """What was read, no longer kept here; None where it was not."""
        ready = self._ready.pop(address, None)
        if ready is None:
            return None
        self.nbytes -= ready.outcome.nbytes
        self.nhits_ahead += ready.was_ahead
        self._ranks.pop(address, None)
        return ready.outcome

    def is_under_way(self, address: BrickAddress) -> bool:
        """Whether somebody reads it now."""
        return address in self._under_way

    def take_over(self, address: BrickAddress) -> None:
        """The caller reads it, and keeps it."""
        self._wanted.pop(address, None)
        self._ahead.pop(address, None)
        self._ranks.pop(address, None)
        self._under_way[address] = False

    def end_take_over(self, address: BrickAddress) -> None:
        """The caller has read it."""
        del self._under_way[address]

    def begin_waiting(self, address: BrickAddress) -> None:
        """Keep it when it comes, whatever its size."""
        self._awaited[address] = self._awaited.get(address, 0) + 1

    def end_waiting(self, address: BrickAddress) -> None:
        """The mirror of `begin_waiting`."""
        self._awaited[address] -= 1
        if not self._awaited[address]:
            del self._awaited[address]

    def clear(self) -> None:
        """Forget all wishes and all that was read."""
        self._wanted.clear()
        self._urged = ()
        self._ahead.clear()
        self._ranks.clear()
        self._ready.clear()
        self.nbytes = 0

    def _unread(self, wishes: dict[BrickAddress, BrickRequest]) -> dict[BrickAddress, BrickRequest]:
        here = (self._ready, self._under_way)
        return {a: r for a, r in wishes.items() if not any(a in known for known in here)}

    def _demote(self, rank: Rank, wishes: Iterable[BrickAddress]) -> None:
        """Only these wishes have this rank from now on."""
        self._ranks = {a: r for a, r in self._ranks.items() if r != rank}
        self._ranks.update(dict.fromkeys(wishes, rank))
        self._rank_ready()

    def _rank_ready(self) -> None:
        for address, ready in self._ready.items():
            ready.rank = self._ranks.get(address, Rank.STALE)

    def _make_room(self, nbytes: int, rank: Rank) -> bool:
        """Drop what is of lower rank, if that makes room for so much."""
        too_much = self.nbytes + nbytes - self._budget_nbytes
        if too_much <= 0:
            return True
        by_rank = sorted(self._ready.items(), key=lambda item: item[1].rank)  # stable: oldest first
        lower = [(a, r.outcome.nbytes) for a, r in by_rank if r.rank < rank]
        if sum(n for _, n in lower) < too_much:
            return False
        for address, n in lower:
            if too_much <= 0:
                break
            if address in self._awaited:
                continue
            del self._ready[address]
            self.nbytes -= n
            too_much -= n
        return too_much <= 0
