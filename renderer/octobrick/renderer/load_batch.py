"""Bricks of one source that are read together, and when that is given up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from octobrick.renderer.brick_request import BrickAddress, BrickRequest
from octobrick.renderer.brick_source import BatchSource, BrickBatch
from octobrick.renderer.load_queue import Outcome

BATCH_MAX: Final = 256
"""Bricks of a batch: on a fast line tenths of a second, so the next view waits no more."""


class LoadBatch:
    """A batch under way. All but `outcomes` and `close` is for who holds the loader's lock.

    Args:
        source: that all are read from.
        requests: most urgent first.
    """

    def __init__(self, source: Any, requests: Sequence[BrickRequest]) -> None:
        self.source = source
        self._requests = list(requests)
        self.left: dict[BrickAddress, BrickRequest] = {r.address: r for r in requests}
        """What has not come yet."""
        self.closed = False
        self._batch: BrickBatch | None = None

    def begin(self) -> BrickBatch:
        """Ask the source; once."""
        places = [(a.level, a.zyx, a.t, a.c) for a in (r.address for r in self._requests)]
        batch: BrickBatch = self.source.brick_codes(places)
        self._batch = batch
        return batch

    def outcomes(self, batch: BrickBatch) -> Iterator[tuple[BrickRequest, Outcome]]:
        """Each brick as it comes. Raises what the source does."""
        for number, code in batch:
            request = self._requests[number]
            yield request, Outcome(error=code) if isinstance(code, Exception) else Outcome(code)

    def close(self) -> None:
        """Let no more come. Never waits; idempotent."""
        self.closed = True
        if self._batch is not None:
            self._batch.close()


def comes_in_batches(request: BrickRequest) -> bool:
    """Whether the source of a request gives many bricks at once."""
    return request.address.kind != "decoded" and isinstance(request.source, BatchSource)
