"""One picture that somebody waits for: where its parts go, and whether it is still wanted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from octobrick.server.pictures.render_task import PicturePart, RenderTask

Event = PicturePart | Exception | None
"""A part of a picture; or the end: an error, or None where all parts were given."""


@dataclass(slots=True, eq=False)
class RenderJob:
    """A task in a pool, from its asking to its end.

    Args:
        task: what to render.
        client: who asked; clients take turns.
        deliver: takes the events, from another thread; the last one is an error or None.

    Attributes:
        asked, started: ``time.monotonic()``; None before it was begun.
        stopped: nobody waits any more; what cannot be stopped at once is finished in vain.
        abandoned: the pool is closing and waits no longer.
    """

    task: RenderTask
    client: str
    deliver: Callable[[Event], None]
    asked: float = field(default_factory=time.monotonic)
    started: float | None = None
    stopped: bool = False
    abandoned: bool = False

    def give(self, event: Event) -> None:
        """Deliver an event, unless nobody waits."""
        if not self.stopped:
            self.deliver(event)
