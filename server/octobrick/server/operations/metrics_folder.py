"""How several processes of one server add up their counts: each leaves its own in a folder.

The supervisor makes the folder, for its user alone, and removes it. Each worker writes its counts
there every second; whichever worker is asked adds what the others wrote to what it has itself.
What a worker counted before it died is kept.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from octobrick.server.operations.metrics import Counts, added, without_gauges

logger = logging.getLogger(__name__)

WRITE_SECONDS = 1.0
_GONE = ".gone"  # instead of .json


class MetricsFolder:
    """The folder of one server's processes.

    Args:
        path: a folder that exists.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def write(self, counts: Counts) -> None:
        """Leave the counts of this process for the others."""
        self._replace(f"{os.getpid()}.json", counts)

    def with_others(self, counts: Counts) -> Counts:
        """The counts of this process and those that the others left last."""
        own = f"{os.getpid()}.json"
        others = [path for path in self._path.glob("*.json") if path.name != own]
        ended = self._path.glob(f"*{_GONE}")
        return added(
            [
                counts,
                *(read for path in others for read in _read(path)),
                *(without_gauges(read) for path in ended for read in _read(path)),
            ]
        )

    def retire(self, pid: int) -> None:
        """Keep what a process counted that has ended, but no longer what it had."""
        path = self._path / f"{pid}.json"
        with contextlib.suppress(FileNotFoundError):  # it ended before it wrote anything
            path.rename(path.with_suffix(_GONE))  # in one step: nothing is counted twice

    def _replace(self, name: str, counts: Counts) -> None:
        part = self._path / f"{name}.part"
        lines = {
            metric: [[list(labels), numbers] for labels, numbers in samples.items()]
            for metric, samples in counts.items()
        }
        try:
            part.write_text(json.dumps(lines))
            part.replace(self._path / name)  # whole or not at all for who reads it meanwhile
        except OSError as error:
            logger.warning("the counts of this process cannot be left for others: %s", error)


def _read(path: Path) -> Iterator[Counts]:
    """The counts in a file; nothing where it has gone meanwhile."""
    try:
        lines = json.loads(path.read_text())
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        logger.warning("the counts in %s cannot be read: %s", path.name, error)
        return
    yield {
        metric: {tuple(labels): numbers for labels, numbers in samples}
        for metric, samples in lines.items()
    }
