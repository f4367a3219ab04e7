"""How long each pass of a frame takes, on the clock that measures the work itself."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import moderngl


class PassClock:
    """Adds up milliseconds by pass.

    On a GPU by timer queries, which do not make the CPU wait. Mesa's software renderer answers
    those with nonsense, but there a finished call is finished work: the wall clock.

    Args:
        gl: the context, current in this thread.
        software: True to use the wall clock.
    """

    def __init__(self, gl: moderngl.Context, *, software: bool) -> None:
        self._gl = gl
        self._software = software
        self._queries: list[tuple[str, moderngl.Query]] = []
        self._milliseconds: dict[str, float] = {}

    @contextmanager
    def measure(self, name: str, *, on_gpu: bool = True) -> Iterator[None]:
        """Count the GL calls of the block (or, on_gpu=False, its own time) under a name."""
        if on_gpu and not self._software:
            query = self._gl.query(time=True)
            with query:
                yield
            self._queries.append((name, query))
            return
        start = time.perf_counter()
        yield
        if on_gpu:
            self._gl.finish()
        self._add(name, 1e3 * (time.perf_counter() - start))

    def milliseconds(self) -> dict[str, float]:
        """The sums so far, by name; waits for the GPU."""
        for name, query in self._queries:
            self._add(name, query.elapsed / 1e6)
        self._queries.clear()
        return dict(self._milliseconds)

    def _add(self, name: str, milliseconds: float) -> None:
        self._milliseconds[name] = self._milliseconds.get(name, 0.0) + milliseconds
