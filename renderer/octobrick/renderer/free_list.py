"""Which bytes of a buffer are free: first fit, and neighbouring holes become one."""

from __future__ import annotations

from bisect import bisect_left


class FreeList:
    """The holes of a buffer.

    Args:
        nbytes: of the buffer, all free at first.
    """

    def __init__(self, nbytes: int) -> None:
        self._nbytes = nbytes
        # Both by place: where holes begin, and how long they are.
        self._starts = [0] if nbytes else []
        self._sizes = [nbytes] if nbytes else []

    @property
    def free_nbytes(self) -> int:
        """Of all holes."""
        return sum(self._sizes)

    @property
    def is_empty(self) -> bool:
        """Whether nothing of the buffer is taken."""
        return self._sizes == [self._nbytes] or not self._nbytes

    def take(self, nbytes: int) -> int | None:
        """Where so many bytes begin, taken from the first hole that has them; None if none has."""
        for i, size in enumerate(self._sizes):
            if size < nbytes:
                continue
            start = self._starts[i]
            if size == nbytes:
                del self._starts[i], self._sizes[i]
            else:
                self._starts[i], self._sizes[i] = start + nbytes, size - nbytes
            return start
        return None

    def give_back(self, start: int, nbytes: int) -> None:
        """Free bytes that were taken."""
        i = bisect_left(self._starts, start)
        if i < len(self._starts) and start + nbytes == self._starts[i]:
            nbytes += self._sizes.pop(i)
            del self._starts[i]
        if i > 0 and self._starts[i - 1] + self._sizes[i - 1] == start:
            self._sizes[i - 1] += nbytes
            return
        self._starts.insert(i, start)
        self._sizes.insert(i, nbytes)
