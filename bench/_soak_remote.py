"""The project's own client in a soak: bricks by many and one by one, through its disk cache.

Run as a program it reads a whole volume with a cache on a disk that is full, and says as JSON what
went wrong: ``_soak_remote.py URL FOLDER CACHE_DIR FILE_NBYTES``; FILE_NBYTES 0 sets no limit.
"""

from __future__ import annotations

import json
import logging
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from _clients import Client

from octobrick.codec.errors import OctobrickError
from octobrick.store import open_volume

if TYPE_CHECKING:
    from _soak_run import Soak

    from octobrick.store import Volume

BRICKS = 24
TINY_NBYTES = 256 * 1024


def ask_remote(soak: Soak, _client: Client, volume_id: str, chance: np.random.Generator) -> None:
    """Open, read many bricks at once, some alone, and the directions where there are some."""
    from _soak_clients import expect_kind, some_place

    from octobrick.store.http_volume import HttpVolume

    seen = 0
    try:
        with open_volume(f"http://127.0.0.1:{soak.port}/v1/volumes/{volume_id}") as remote:
            assert isinstance(remote, HttpVolume)
            local = soak.truth.volume(remote.revision)
            asked = [some_place(soak, remote.revision, chance) for _ in range(BRICKS)]
            places = [(level, (z, y, x), t, c) for level, t, c, z, y, x in asked]
            for number, code in remote.brick_codes(places):
                if isinstance(code, OctobrickError):  # of one brick it is given, not raised
                    expect_kind(soak, "client", volume_id, code.kind, str(code))
                    continue
                if code != local.brick_code(*places[number]):
                    soak.is_wrong(f"WRONG BYTES: client, {volume_id} {places[number]}")
                seen += 1
            for place in places[:3]:
                if not np.array_equal(remote.brick(*place), local.brick(*place)):
                    soak.is_wrong(f"WRONG VOXELS: client, {volume_id} {place}")
                seen += 1
            seen += _ask_gradients(soak, remote, local, [p for p in places if p[0] > 0])
    except OctobrickError as error:
        expect_kind(soak, "client", volume_id, error.kind, str(error))
    soak.count("client", verified=seen)


def _ask_gradients(soak: Soak, remote: Volume, local: Volume, places: list[Any]) -> int:
    if local.gradients is None or remote.gradients is None:
        if (local.gradients is None) != (remote.gradients is None):
            soak.is_wrong("the client and the folder differ in having gradients")
        return 0
    for place in places:  # one by one here, in streams by `ask_gradients`
        if remote.gradients.code(*place) != local.gradients.code(*place):
            soak.is_wrong(f"WRONG BYTES: client, directions of {place}")
    return len(places)


def fill_cache(soak: Soak) -> bool:
    """The disk under a client's cache is full: nothing may be wrong, one warning says so."""
    url = f"http://127.0.0.1:{soak.port}/v1/volumes/steady"
    with _tiny_disk(soak.folder / "tiny") as (folder, limit_nbytes):
        command = [sys.executable, __file__, url, str(soak.served / "steady.zarr"), str(folder)]
        done = subprocess.run(
            [*command, str(limit_nbytes)], capture_output=True, text=True, timeout=120
        )
    if done.returncode:
        soak.is_wrong(f"a client whose cache is full fails: {done.stderr[-500:]}")
        return True
    told = json.loads(done.stdout)
    soak.count("client, cache full", verified=told["bricks"])
    if told["wrong"]:
        soak.is_wrong(f"WRONG BYTES: client whose cache is full: {told['wrong']}")
    if len(told["warnings"]) != 1:
        soak.is_wrong(f"a client whose cache is full warns {told['warnings']}, not once")
    else:
        soak.saw("client's cache full", "file too large" if limit_nbytes else "disk full")
    return True


@contextmanager
def _tiny_disk(folder: Path) -> Iterator[tuple[Path, int]]:
    """A file system of 256 KiB; where none may be mounted, a limit on the size of files."""
    folder.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={TINY_NBYTES}", "octobrick-soak", str(folder)]
    try:
        is_mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        is_mounted = False
    try:
        yield folder, 0 if is_mounted else 4096
    finally:
        if is_mounted:
            subprocess.run(["umount", str(folder)], check=True)


def read_with_full_cache(url: str, path: str, cache: Path, limit_nbytes: int) -> dict[str, Any]:
    """Compare every brick; what differed, and what was warned of."""
    from octobrick.store.brick_cache import BrickCache
    from octobrick.store.http_volume import HttpVolume

    warnings: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: warnings.append(record.getMessage())  # type: ignore[method-assign]
    logging.getLogger("octobrick").addHandler(handler)
    if limit_nbytes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit_nbytes, limit_nbytes))
    wrong, bricks = [], 0
    with open_volume(path) as local, HttpVolume(url, cache=BrickCache(cache)) as remote:
        for level in local.levels:
            places = [(level.index, zyx, 0, 0) for zyx in np.ndindex(*level.grid_zyx)]
            for number, code in remote.brick_codes(places):
                wrong += [places[number]] if code != local.brick_code(*places[number]) else []
            wrong += [p for p in places if not np.array_equal(remote.brick(*p), local.brick(*p))]
            bricks += 2 * len(places)
    return {"wrong": wrong, "bricks": bricks, "warnings": warnings}


if __name__ == "__main__":
    print(
        json.dumps(
            read_with_full_cache(sys.argv[1], sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]))
        )
    )
