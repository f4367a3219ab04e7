"""When to try again: exponential backoff with jitter, up to a deadline."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from dataclasses import dataclass

from octobrick.codec.errors import OctobrickError

RETRY_AFTER_SECONDS_MAX = 30.0
"""A server that asks for more is not waited for longer."""


@dataclass(frozen=True, slots=True)
class RetryPolicy:
    """How often, and for how long, something is tried again.

    Attributes:
        first_seconds: pause after the first failure, about; each next is twice as long.
        longest_seconds: no pause is longer, but one that the server asks for.
        deadline_seconds: after the first failure; then its error is the caller's.
    """

    first_seconds: float = 0.1
    longest_seconds: float = 5.0
    deadline_seconds: float = 60.0


class Retries:
    """The failures of one task so far. Not thread-safe.

    Args:
        policy: what is allowed.
        pause: waits for so many seconds; raises where there is no use any more.
        clock: seconds.
    """

    def __init__(
        self,
        policy: RetryPolicy,
        pause: Callable[[float], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._policy, self._pause, self._clock = policy, pause, clock
        self.count = 0
        self._began_seconds = 0.0

    def progressed(self) -> None:
        """Something arrived: the next failure is a first one."""
        self.count = 0

    def wait_after(self, error: OctobrickError, asked_seconds: float | None = None) -> None:
        """Pause before another try; raises the error where its time is over.

        Args:
            error: why.
            asked_seconds: what the server asks to wait.
        """
        if self.count == 0:
            self._began_seconds = self._clock()
        policy = self._policy
        longest = min(policy.longest_seconds, policy.first_seconds * 2 ** min(self.count, 20))
        seconds = longest * random.uniform(0.5, 1.0)  # noqa: S311  (spreads clients, no secret)
        if asked_seconds is not None:
            seconds = max(seconds, min(asked_seconds, RETRY_AFTER_SECONDS_MAX))
        self.count += 1
        if self._clock() + seconds - self._began_seconds > policy.deadline_seconds:
            raise error
        self._pause(seconds)
