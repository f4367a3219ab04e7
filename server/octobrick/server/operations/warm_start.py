"""Opens volumes and reads their tables ahead of the first request, in the background."""

from __future__ import annotations

import itertools
import logging
import threading
import time

import numpy as np

from octobrick.codec.errors import OctobrickError
from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.store.level import Level

logger = logging.getLogger(__name__)

_VOLUMES_MAX = 64
_TABLE_BRICKS_MAX = 1 << 20  # of a level whose tables are read: some 10 MB
_SHARDS_MAX = 16  # of a level whose indexes are read
_SECONDS_MAX = 30.0  # then whoever asks first waits for the rest


class WarmStart:
    """A thread that makes first requests as fast as later ones, as far as bounds allow.

    It reads metadata, the range and fidelity of bricks, and shard indexes, coarse levels first;
    of the bricks themselves one for each shard. What cannot be read is left to requests.

    Args:
        catalog: its volumes are opened, the first ones of the list.
    """

    def __init__(self, catalog: Catalog) -> None:
        self._catalog = catalog
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="octobrick-warm", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop after what is being read now."""
        self._stopping.set()
        self._thread.join()

    def wait(self) -> None:
        """Wait until all is read that will be."""
        self._thread.join()

    def _run(self) -> None:
        end = time.monotonic() + _SECONDS_MAX
        warmed = 0
        try:
            for volume_id in self._catalog.scan()[:_VOLUMES_MAX]:
                if self._stopping.is_set() or time.monotonic() > end:
                    break
                warmed += self._warm(volume_id, end)
        except Exception:  # warmth is worth no crash
            logger.exception("the warm start broke off")
        logger.info("%d volumes are open and warm", warmed)

    def _warm(self, volume_id: str, end: float) -> bool:
        try:
            with self._catalog.borrow(volume_id) as lent:
                for level in reversed(lent.volume.levels):
                    if self._stopping.is_set() or time.monotonic() > end:
                        break
                    _warm_level(lent, level)
        except OctobrickError as error:
            logger.warning("volume %s is not warm: %s", volume_id, error.message)
            return False
        return True


def _warm_level(lent: OpenVolume, level: Level) -> None:
    if np.prod(level.grid_zyx) <= _TABLE_BRICKS_MAX:
        lent.ranges(level.index, 0, 0)
        lent.fidelity(level.index, 0, 0)
    steps = lent.volume.shard_shape_zyx
    firsts = itertools.product(
        *(range(0, n, step) for n, step in zip(level.grid_zyx, steps, strict=True))
    )
    for z, y, x in itertools.islice(firsts, _SHARDS_MAX):
        lent.volume.stored_brick(level.index, (z, y, x))
