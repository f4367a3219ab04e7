"""One soak: a server, its volumes and their true bytes, clients in threads, faults in turn."""

from __future__ import annotations

import http.client
import os
import shutil
import sys
import threading
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from _clients import Client, Place
from _processes import descendants, descriptors, growth, resident_nbytes
from _soak_clients import ORIGIN, PageClient
from _soak_faults import FAULTS
from _soak_guarded import Guarded
from _soak_jobs import ALL_JOBS

from octobrick.codec import S3dc
from octobrick.store import Volume, ingest, open_volume

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "script" / "lib"))
SAMPLE_SECONDS = 0.5
CACHE_NBYTES = 2_000_000  # of the project's client: less than the volumes, so that it makes room


class Truth:
    """The true bytes of every revision that was ever served; copies that no fault touches."""

    def __init__(self) -> None:
        self._volumes: dict[str, Volume] = {}
        self._lock = threading.Lock()

    def add(self, path: Path) -> str:
        """Learn a volume; returns its revision."""
        volume = open_volume(path)
        with self._lock:
            self._volumes[volume.revision] = volume
        return volume.revision

    def volume(self, revision: str) -> Volume:
        """The volume of a revision."""
        return self._volumes[revision]

    def stored(self, revision: str, place: Place) -> bytes | None:
        """A brick's bytes on disk; None where it is absent."""
        level, t, c, z, y, x = place
        return self._volumes[revision].stored_brick(level, (z, y, x), t, c)

    def close(self) -> None:
        """Close them."""
        for volume in self._volumes.values():
            volume.close()


class Soak:
    """State that clients and faults share.

    Args:
        folder: for volumes, copies and the log.
        source: what to ingest; None for a noisy ball of 96 x 128 x 128.
        clients: threads.
        workers: server processes.
    """

    def __init__(self, folder: Path, source: Path | None, clients: int, workers: int) -> None:
        self.folder, self.served = folder, folder / "served"
        self.truth = Truth()
        self.stopping = threading.Event()
        self.requests: Counter[str] = Counter()
        self.errors: Counter[str] = Counter()
        self.fault_kinds: dict[str, Counter[str]] = {name: Counter() for name in FAULTS}
        self.injected: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.verified = 0
        self.pid, self.port, self.workers = 0, 0, workers
        self.killed_seconds = 0.0  # connections made before may break off
        self.guarded = Guarded(folder)
        self._clients = clients
        self._lock = threading.Lock()
        self._make_volumes(source)

    def run(self, seconds: float) -> dict[str, Any]:
        """Serve, ask and break things for so long; returns the figures."""
        from children import ServerProcess

        os.environ["OCTOBRICK_CORS_ORIGINS"] = f'["{ORIGIN}"]'
        os.environ["OCTOBRICK_WORKERS"] = str(self.workers)
        os.environ["OCTOBRICK_CACHE_DIR"] = str(self.folder / "cache")
        os.environ["OCTOBRICK_CACHE_NBYTES"] = str(CACHE_NBYTES)
        with ExitStack() as stack:
            with self.guarded.settings():
                closed = stack.enter_context(ServerProcess(self.served, self.folder / "closed.log"))
            self.guarded.port = int(closed.url.rsplit(":", 1)[1])
            server = stack.enter_context(ServerProcess(self.served, self.folder / "log"))
            self.port = int(server.url.rsplit(":", 1)[1])
            self.pid = server.pid
            self._servers = (server.pid, closed.pid)
            threads = [
                threading.Thread(target=self._ask, args=(number,))
                for number in range(self._clients)
            ]
            threads.append(threading.Thread(target=self._break, args=(seconds,)))
            for thread in threads:
                thread.start()
            memory, files = self._watch(seconds)
            self.stopping.set()
            for thread in threads:
                thread.join()
        self.truth.close()
        return {
            "seconds": seconds,
            "requests": dict(sorted(self.requests.items())),
            "errors": dict(self.errors),
            "verified_bricks": self.verified,
            "wrong": self.wrong,
            "faults": {
                name: {
                    "injected": self.injected[name],
                    "seen": sum(kinds.values()),
                    "kinds": sorted(kinds),
                }
                for name, kinds in self.fault_kinds.items()
            },
            "memory": growth(memory),
            "descriptors": growth(files),
        }

    def client(self) -> Client:
        """A new connection to the server."""
        return Client("127.0.0.1", self.port)

    def saw(self, fault: str, kind: str) -> None:
        """Note that a fault was answered."""
        with self._lock:
            self.fault_kinds[fault][kind] += 1

    def count(self, name: str, verified: int = 0) -> None:
        """Note an answer, and how many bricks in it were compared."""
        with self._lock:
            self.requests[name] += 1
            self.verified += verified

    def count_error(self, kind: str) -> None:
        """Note an error that the server answered."""
        with self._lock:
            self.errors[kind] += 1

    def is_wrong(self, what: str) -> None:
        """Note a broken promise; the first hundred are enough to see why."""
        with self._lock:
            if len(self.wrong) < 100:
                self.wrong.append(what)

    def _make_volumes(self, source: Path | None) -> None:
        self.served.mkdir()
        voxels = self.folder / "voxels.npy"
        if source is None:
            z, y, x = np.ogrid[:96, :128, :128]
            noise = np.random.default_rng(1).integers(0, 40, (96, 128, 128))
            ball = 3000 - ((z - 48) ** 2 + (y - 64) ** 2 + (x - 64) ** 2)
            np.save(voxels, (np.clip(ball, 0, None) + noise * (ball > 0)).astype(np.uint16))
        made = self.folder / "made"
        made.mkdir()
        for name, codec in (("steady", S3dc()), ("damaged", None), ("first", S3dc())):
            path = made / f"{name}.zarr"
            directed = name == "steady"
            ingest(source or voxels, path, codec=codec, brick=32, workers=1, gradients=directed)
        ingest(source or voxels, made / "second.zarr", codec=S3dc(bits=2), brick=32, workers=1)
        for path in made.iterdir():
            self.truth.add(path)
        for name in ("steady", "damaged"):
            shutil.copytree(made / f"{name}.zarr", self.served / f"{name}.zarr")
        shutil.copytree(made / "first.zarr", self.served / "replaced.zarr")

    def _ask(self, number: int) -> None:
        chance = np.random.default_rng(number)
        weights = np.array([job.weight for job in ALL_JOBS], float)
        kind = PageClient if number % 2 else Client
        client = kind("127.0.0.1", self.port)
        while not self.stopping.is_set():
            job = ALL_JOBS[int(chance.choice(len(ALL_JOBS), p=weights / weights.sum()))]
            volume_id = str(chance.choice(["steady", "damaged", "replaced"]))
            try:
                job.do(self, client, volume_id, chance)
            except Exception as error:  # whatever a client meets that was not promised
                if self._is_of_the_killed(client, error):
                    self.saw("server worker killed", "connection broke off")
                elif not self.stopping.is_set():
                    self.is_wrong(f"{job.name} of {volume_id}: {type(error).__name__}: {error}")
                client.close()
        client.close()

    def _is_of_the_killed(self, client: Client, error: Exception) -> bool:
        """Whether a connection broke that was made before a server worker was killed."""
        broke = isinstance(error, (ConnectionError, http.client.HTTPException, EOFError))
        return broke and client.opened_seconds < self.killed_seconds

    def _break(self, seconds: float) -> None:
        """Each fault in turn, as many rounds as fit; a fault undoes itself."""
        pause = max(0.3, min(5.0, seconds / (2 * len(FAULTS))))
        while True:
            for name, inject in FAULTS.items():
                if self.stopping.wait(pause):
                    return
                try:
                    if inject(self):
                        self.injected[name] += 1
                except Exception as error:
                    self.is_wrong(f"fault {name}: {type(error).__name__}: {error}")

    def _watch(self, seconds: float) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        memory, files = [], []
        begin = time.monotonic()
        while (now := time.monotonic() - begin) < seconds:
            tree = [pid for root in self._servers for pid in (root, *descendants(root))]
            memory.append((now, float(sum(map(resident_nbytes, tree)))))
            files.append((now, float(sum(map(descriptors, tree)))))
            time.sleep(SAMPLE_SECONDS)
        return memory, files
