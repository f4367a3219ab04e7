"""A queue in which clients take turns, so that one who asks for much does not keep others out."""

from __future__ import annotations

from collections import OrderedDict, deque

from octobrick.server.errors import BusyError
from octobrick.server.pictures.render_job import RenderJob


class FairQueue:
    """Jobs by client: round robin over the clients, in the order asked within each. Not locked.

    Args:
        length: jobs that may wait, of all clients.
        length_per_client: of each.
    """

    def __init__(self, length: int, length_per_client: int) -> None:
        self._length = length
        self._length_per_client = length_per_client
        self._clients: OrderedDict[str, deque[RenderJob]] = OrderedDict()
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def put(self, job: RenderJob) -> None:
        """Queue a job.

        Raises:
            BusyError: all places are taken, or all that this client may have.
        """
        own = self._clients.get(job.client, ())
        if self._count >= self._length:
            raise BusyError(
                f"{self._count} pictures wait for the renderer already; try again later",
                limit_name="render_queue_length",
                limit=self._length,
            )
        if len(own) >= self._length_per_client:
            raise BusyError(
                f"{len(own)} of your pictures wait for the renderer already; try again later",
                limit_name="render_queue_per_client",
                limit=self._length_per_client,
            )
        self._clients.setdefault(job.client, deque()).append(job)
        self._count += 1

    def take(self) -> RenderJob | None:
        """The next job of the client whose turn it is; None where none waits."""
        if not self._clients:
            return None
        client, jobs = self._clients.popitem(last=False)
        job = jobs.popleft()
        if jobs:
            self._clients[client] = jobs  # behind all others
        self._count -= 1
        return job

    def remove(self, job: RenderJob) -> bool:
        """Take a job out; False where it does not wait."""
        jobs = self._clients.get(job.client)
        if jobs is None or job not in jobs:
            return False
        jobs.remove(job)
        if not jobs:
            del self._clients[job.client]
        self._count -= 1
        return True
