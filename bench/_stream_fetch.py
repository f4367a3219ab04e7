"""One fetch of a working set, run behind a shaped link: see service_stream.py."""

from __future__ import annotations

import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from _clients import STORED, Client, Place, records, zstd_checked
from _shaped_link import received_nbytes

from octobrick.store import Volume, open_volume

V1 = "/v1/volumes"
VIEW = "preset=ct-bone&azimuth=30&elevation=15&width=1024&height=1024&budget_nbytes=1000000000"
# Without select: of the largest value, what bone begins at in a CT of 8 bits.
WANTED_FROM = 0.35


def main() -> None:
    """way, host, port, folder of the same volumes → figures as JSON."""
    way, host, port, served = sys.argv[1:]
    name = "raw" if way.startswith("raw") else "head"
    client = Client(host, int(port))
    routes = client.ask("GET", "/openapi.json").json()["paths"]
    if way == "batch" and V1 + "/{volume_id}/bricks" not in routes:
        print("{}")
        return
    client.close()
    view = f"{V1}/head/select?{VIEW}" if V1 + "/{volume_id}/select" in routes else None
    with open_volume(Path(served) / f"{name}.zarr") as volume:
        print(json.dumps(fetch(way, (host, int(port)), name, volume, view)))


def working_set(
    volume: Volume, client: Client, view: str | None
) -> tuple[list[Place], list[Place]]:
    """The coarsest level, and what a view needs, by select; or all that bone could show."""
    last = len(volume.levels) - 1
    coarse = [(last, 0, 0, z, y, x) for z, y, x in np.ndindex(*volume.levels[last].grid_zyx)]
    if view is not None:
        chosen = client.ask("GET", view).json()["bricks"]
        return coarse, [(level, t, c, z, y, x) for level, t, c, z, y, x in chosen]
    high = volume.ranges(0, 0, 0)[..., 1].astype(float)
    shown = np.argwhere(high > WANTED_FROM * high.max()).tolist()
    fine = [(0, 0, 0, z, y, x) for z, y, x in shown]
    return coarse, fine


def fetch(
    way: str, server: tuple[str, int], name: str, volume: Volume, view: str | None
) -> dict[str, Any]:
    """From a cold client: metadata, then the coarse level, then all the rest."""
    guide = Client(*server)
    coarse, fine = working_set(volume, guide, view)
    guide.close()
    before, begin = received_nbytes(), time.perf_counter()
    client = Client(*server)
    revision = client.ask("GET", f"{V1}/{name}").json()["revision"]
    if way == "batch":
        coarse, fine = working_set(volume, client, view)  # this way has to ask for it
        got, first = _batch(client, name, revision, [*coarse, *fine], len(coarse), begin)
    else:
        got, first = _single(way, server, name, revision, (coarse, fine), begin)
    end = time.perf_counter()
    moved = received_nbytes() - before
    _compare(got, volume, plain=way.startswith("raw"))
    return {
        "bricks": len(got),
        "first_seconds": first - begin,
        "all_seconds": end - begin,
        "link_nbytes": moved,
    }


def _batch(
    client: Client, name: str, revision: str, places: list[Place], coarse: int, begin: float
) -> tuple[dict[Place, bytes], float]:
    got: dict[Place, bytes] = {}
    first = begin
    body = {"revision": revision, "bricks": places}
    reply = client.open("POST", f"{V1}/{name}/bricks", body)
    assert reply.status == 200, reply.read()
    for index, status, payload in records(reply, len(places)):
        got[places[index]] = payload if status == STORED else b""
        if index == coarse - 1:
            first = time.perf_counter()
    return got, first


def _single(
    way: str,
    server: tuple[str, int],
    name: str,
    revision: str,
    parts: tuple[list[Place], list[Place]],
    begin: float,
) -> tuple[dict[Place, bytes], float]:
    got: dict[Place, bytes] = {}
    coding = "identity" if way.startswith("raw") else "zstd"
    clients = [Client(*server) for _ in range(int(way.rsplit("-", 1)[1]))]

    def take(job: tuple[Client, list[Place]]) -> None:
        client, places = job
        for place in places:
            path = f"{V1}/{name}/{revision}/bricks/" + "/".join(map(str, place))
            reply = client.ask("GET", path, accept_encoding=coding)
            assert reply.status in (200, 204), reply
            got[place] = reply.body

    first = begin
    with ThreadPoolExecutor(len(clients)) as pool:
        for number, part in enumerate(parts):
            shares = [(c, part[i :: len(clients)]) for i, c in enumerate(clients)]
            list(pool.map(take, shares))
            if number == 0:
                first = time.perf_counter()
    return got, first


def _compare(got: dict[Place, bytes], volume: Volume, *, plain: bool) -> None:
    for (level, t, c, z, y, x), body in got.items():
        stored = volume.stored_brick(level, (z, y, x), t, c) or b""
        expected = zstd_checked(stored) if plain and stored else stored
        if body != expected:
            raise SystemExit(f"wrong bytes of brick {(level, t, c, z, y, x)}")


if __name__ == "__main__":
    main()
