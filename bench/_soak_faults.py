"""The faults of a soak. Each says whether it could be injected, and undoes what it did."""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from _clients import HEADER
from _processes import children, command_of, descendants
from _soak_remote import fill_cache

if TYPE_CHECKING:
    from _soak_run import Soak

V1 = "/v1/volumes"
DAMAGE_SECONDS = 1.0
DYING_SECONDS = 0.5  # a connection made so soon after may still be the dead one's
COMES_BACK_SECONDS = 45.0  # the supervisor waits for up to 30 s


def kill_worker(soak: Soak) -> bool:
    """A render worker is killed outright; the server must go on."""
    workers = [pid for pid in descendants(soak.pid) if "render" in command_of(pid)]
    if not workers:
        return False
    os.kill(workers[0], signal.SIGKILL)
    client = soak.client()
    assert client.ask("GET", "/healthz").status == 200, "the server died with its worker"
    reply = client.ask("GET", f"{V1}/steady/render?width=64&height=48&preset=microscopy")
    client.close()
    if reply.status == 503 and "retry-after" in reply.headers:
        soak.saw("worker killed", reply.kind())
    elif reply.status == 200:
        soak.saw("worker killed", "fresh worker")
    else:
        soak.is_wrong(f"a picture after a render worker was killed: {reply.status}")
    return True


def kill_server(soak: Soak) -> bool:
    """One of several server processes is killed; only what it was at may break off."""
    if soak.workers < 2:
        return False
    victim = min(_server_workers(soak))  # the oldest: one that lived long is replaced at once
    orphans = descendants(victim)
    os.kill(victim, signal.SIGKILL)
    soak.killed_seconds = time.monotonic() + DYING_SECONDS
    end = time.monotonic() + COMES_BACK_SECONDS
    while time.monotonic() < end and not soak.stopping.is_set():
        client = soak.client()
        status = client.ask("GET", "/healthz").status
        client.close()
        if status != 200:
            soak.is_wrong(f"/healthz is {status} after a server worker was killed")
        alive = [pid for pid in _server_workers(soak) if pid != victim]
        if len(alive) == soak.workers and not any(map(command_of, orphans)):
            soak.saw("server worker killed", "replaced")
            return True
        time.sleep(0.2)
    if not soak.stopping.is_set():
        soak.is_wrong("a killed server worker was not replaced, or left processes behind")
    return False


def _server_workers(soak: Soak) -> list[int]:
    return [pid for pid in children(soak.pid) if "spawn_main" in command_of(pid)]


def cut_shard(soak: Soak) -> bool:
    """The largest shard loses its second half for a while, in a copy that is only served."""
    path = soak.served / "damaged.zarr"
    shard = max((p for p in path.glob("0/**/*") if p.is_file()), key=lambda p: p.stat().st_size)
    whole = shard.read_bytes()
    try:
        os.truncate(shard, len(whole) // 2)
        _ask_until_damage_shows(soak)
        time.sleep(DAMAGE_SECONDS)
    finally:
        with shard.open("r+b") as file:
            file.write(whole)
    return True


def _ask_until_damage_shows(soak: Soak) -> None:
    """Ask for each brick of level 0: those that are gone must be said to be damaged."""
    client = soak.client()
    revision = client.ask("GET", f"{V1}/damaged").json()["revision"]
    volume = soak.truth.volume(revision)
    nz, ny, nx = volume.levels[0].grid_zyx
    kinds = set()
    for z, y, x in ((z, y, x) for z in range(nz) for y in range(ny) for x in range(nx)):
        address = f"{V1}/damaged/{revision}/bricks/0/0/0/{z}/{y}/{x}"
        reply = client.ask("GET", address, accept_encoding="zstd")
        if reply.status in (200, 204):
            truth = soak.truth.stored(revision, (0, 0, 0, z, y, x))
            if (reply.body if reply.status == 200 else None) != truth:
                soak.is_wrong(f"WRONG BYTES while the shard is cut short: {(z, y, x)}")
        else:
            kinds.add(reply.kind())
    client.close()
    for kind in kinds:
        if kind in ("corrupt-brick", "corrupt-volume"):
            soak.saw("shard cut short", kind)
        else:
            soak.is_wrong(f"a shard that is cut short gives {kind}")


def replace_volume(soak: Soak) -> bool:
    """Another revision is moved into the place of a volume that is being read."""
    place = soak.served / "replaced.zarr"
    client = soak.client()
    before = client.ask("GET", f"{V1}/replaced").json()["revision"]
    fresh, old = soak.folder / "fresh", soak.folder / "old"
    names = {soak.truth.add(soak.folder / "made" / f"{n}.zarr"): n for n in ("first", "second")}
    (name,) = (name for revision, name in names.items() if revision != before)
    shutil.copytree(soak.folder / "made" / f"{name}.zarr", fresh)
    place.rename(old)
    fresh.rename(place)
    gone = client.ask("GET", f"{V1}/replaced/{before}/bricks/0/0/0/0/0/0", accept_encoding="zstd")
    client.close()
    if gone.status == 410:
        soak.saw("volume replaced", gone.kind())
    else:
        soak.is_wrong(f"an address of the old revision gives {gone.status}")
    shutil.rmtree(old)
    return True


def leave_batch(soak: Soak) -> bool:
    """A client goes away with most of its batch unread."""
    client = soak.client()
    revision = client.ask("GET", f"{V1}/steady").json()["revision"]
    body = {"revision": revision, "bricks": [[0, 0, 0, 0, 0, 0]] * 2_000}
    reply = client.open("POST", f"{V1}/steady/bricks", body)
    assert reply.status == 200, reply.status
    assert len(reply.read(HEADER.size)) == HEADER.size
    client.close()
    asker = soak.client()
    if asker.ask("GET", "/healthz").status == 200:
        soak.saw("client leaves a batch", "goes on")
    asker.close()
    return True


def read_slowly(soak: Soak) -> bool:
    """A client takes a batch in drops, and gets all of it all the same."""
    client = soak.client()
    revision = client.ask("GET", f"{V1}/steady").json()["revision"]
    body = {"revision": revision, "bricks": [[0, 0, 0, 1, 1, 1]] * 200}
    reply = client.open("POST", f"{V1}/steady/bricks", body)
    for _ in range(20):
        reply.read(2_000)
        time.sleep(0.02)
    end = reply.read()[-16:]
    client.close()
    assert end[4] == 255, "a slow reader's stream has no end record"
    soak.saw("slow reader", "whole")
    return True


FAULTS: dict[str, Callable[[Soak], bool]] = {
    "worker killed": kill_worker,
    "shard cut short": cut_shard,
    "volume replaced": replace_volume,
    "client leaves a batch": leave_batch,
    "slow reader": read_slowly,
    "client's cache full": fill_cache,
    "server worker killed": kill_server,
}
