"""Batches of bricks beside single requests, over HTTP from one Python client.

    script/bench service_batch [--quick] [--json FILE]

A server of its own on loopback, and one client with one connection (http.client), alternating:
256 bricks in as many requests, each with its status and headers; the same in one brick stream,
each record checked. *Noise* does not compress: some 130 KB a brick. *Waves* do: a few KB. Bricks
a second, and the seconds until the first brick of a batch is there.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import _measure
import numpy as np

from octobrick.codec import S3dc
from octobrick.store import ingest, open_volume
from octobrick.store.brick_stream import BrickStreamReader, Kind, stored_nbytes_max

SHAPE = (256, 512, 512)  # 256 bricks of 64³
ROUNDS = 7


def make_volumes(folder: Path) -> None:
    """One volume whose bricks do not compress, and one whose do."""
    z, y, x = np.ogrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]]
    waves = (60 * (np.sin(z / 40) + np.sin(y / 50)) + x / 8 + 120).astype(np.uint8)
    noise = np.random.default_rng(1).integers(1, 256, SHAPE, np.uint8)
    for name, voxels in (("noise", noise), ("waves", waves)):
        np.save(folder / "source.npy", voxels)
        ingest(folder / "source.npy", folder / f"{name}.zarr", codec=S3dc())


@contextmanager
def server(folder: Path) -> Iterator[HTTPConnection]:
    """A connection to a server of a folder."""
    command = [sys.executable, "-m", "octobrick.server.cli", "serve", str(folder), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://([\d.]+):(\d+)", process.stdout.readline())
            assert found, "the server did not start"
            yield HTTPConnection(found[1], int(found[2]))
        finally:
            process.terminate()


class Client:
    """Reads the bricks of a volume, one by one or in batches."""

    def __init__(self, connection: HTTPConnection, folder: Path, name: str) -> None:
        volume = open_volume(folder / f"{name}.zarr")
        self._connection, self._name, self._revision = connection, name, volume.revision
        grid = np.ones(volume.levels[0].grid_zyx, bool)
        self.places = [[0, 0, 0, *zyx] for zyx in np.argwhere(grid).tolist()]
        self._limit = stored_nbytes_max(volume.code_nbytes_max(0))
        self.first_seconds: list[float] = []
        self.nbytes = 0

    def single(self) -> None:
        """Each brick in a request of its own."""
        for place in self.places:
            path = f"/v1/volumes/{self._name}/{self._revision}/bricks/"
            self._connection.request(
                "GET", path + "/".join(map(str, place)), headers={"Accept-Encoding": "zstd"}
            )
            reply = self._connection.getresponse()
            reply.read()
            assert reply.status == 200

    def batch(self) -> None:
        """All bricks in one stream, each checked."""
        body = json.dumps({"revision": self._revision, "bricks": self.places})
        start = time.perf_counter()
        path = f"/v1/volumes/{self._name}/bricks"
        headers = {"Content-Type": "application/json"}
        self._connection.request("POST", path, body, headers)
        reply = self._connection.getresponse()
        assert reply.status == 200
        reader = BrickStreamReader(Kind.VOXELS, len(self.places), lambda _: self._limit)
        self.nbytes = 0
        while piece := reply.read1(1 << 18):
            for record in reader.feed(piece):
                if record.index == 0:
                    self.first_seconds.append(time.perf_counter() - start)
                self.nbytes += len(record.payload)
        reader.finish()


def run(_data: Path, quick: bool) -> dict[str, Any]:
    """Bricks a second of both volumes, both ways."""
    found: dict[str, Any] = {}
    with TemporaryDirectory() as name:
        folder = Path(name)
        make_volumes(folder)
        with server(folder) as connection:
            for volume in ("noise", "waves"):
                client = Client(connection, folder, volume)
                calls = {"single": client.single, "batch": client.batch}
                took = _measure.alternating(calls, 3 if quick else ROUNDS)
                count = len(client.places)
                found[volume] = {
                    "bricks": count,
                    "brick_nbytes": client.nbytes / count,
                    "single_per_second": count / took["single"],
                    "batch_per_second": count / took["batch"],
                    "first_brick_seconds": float(np.median(client.first_seconds)),
                    "batch_seconds": took["batch"],
                }
    return found


def table(result: dict[str, Any]) -> str:
    """A line for each volume."""
    head = ["bricks of", "KB each", "single /s", "batch /s", "ratio", "first ms", "all ms"]
    rows = [
        [
            name,
            f"{row['brick_nbytes'] / 1e3:.1f}",
            f"{row['single_per_second']:.0f}",
            f"{row['batch_per_second']:.0f}",
            f"{row['batch_per_second'] / row['single_per_second']:.2f}",
            f"{row['first_brick_seconds'] * 1e3:.1f}",
            f"{row['batch_seconds'] * 1e3:.0f}",
        ]
        for name, row in result.items()
    ]
    return _measure.layout(head, rows)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
