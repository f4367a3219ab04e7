"""One soak: a server, its volumes and their true bytes, clients in threads, faults in turn."""

from __future__ import annotations

import re
import shutil
import sys
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from _clients import Client, Place
from _processes import descendants, descriptors, growth, resident_nbytes
from _soak_clients import ALL_JOBS, Job
from _soak_faults import FAULTS

from octobrick.codec import S3dc
from octobrick.store import Volume, ingest, open_volume

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "script" / "lib"))
SAMPLE_SECONDS = 0.5


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
    """

    def __init__(self, folder: Path, source: Path | None, clients: int) -> None:
        self.folder, self.served = folder, folder / "served"
        self.truth = Truth()
        self.stopping = threading.Event()
        self.requests: Counter[str] = Counter()
        self.errors: Counter[str] = Counter()
        self.fault_kinds: dict[str, Counter[str]] = {name: Counter() for name in FAULTS}
        self.injected: Counter[str] = Counter()
        self.wrong: list[str] = []
        self.verified = 0
        self.routes: set[str] = set()
        self.pid, self.port = 0, 0
        self._clients = clients
        self._lock = threading.Lock()
        self._make_volumes(source)

    def run(self, seconds: float) -> dict[str, Any]:
        """Serve, ask and break things for so long; returns the figures."""
        from children import ServerProcess

        with ServerProcess(self.served, self.folder / "log") as server:
            self.port = int(server.url.rsplit(":", 1)[1])
            self.pid = server.pid
            self.routes = set(self.client().ask("GET", "/openapi.json").json()["paths"])
            jobs = [job for job in ALL_JOBS if self.has(job.route)]
            threads = [
                threading.Thread(target=self._ask, args=(jobs, number))
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
            "absent": sorted(job.name for job in ALL_JOBS if not self.has(job.route)),
        }

    def has(self, route: str) -> bool:
        """Whether the server describes a route; what parameters are called does not matter."""
        return any(_bare(route) == _bare(described) for described in self.routes)

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
            ingest(source or voxels, path, codec=codec, brick=32, workers=1)
        ingest(source or voxels, made / "second.zarr", codec=S3dc(bits=2), brick=32, workers=1)
        for path in made.iterdir():
            self.truth.add(path)
        for name in ("steady", "damaged"):
            shutil.copytree(made / f"{name}.zarr", self.served / f"{name}.zarr")
        shutil.copytree(made / "first.zarr", self.served / "replaced.zarr")

    def _ask(self, jobs: list[Job], number: int) -> None:
        chance = np.random.default_rng(number)
        weights = np.array([job.weight for job in jobs], float)
        client = self.client()
        while not self.stopping.is_set():
            job = jobs[int(chance.choice(len(jobs), p=weights / weights.sum()))]
            volume_id = str(chance.choice(["steady", "damaged", "replaced"]))
            try:
                job.do(self, client, volume_id, chance)
            except Exception as error:  # whatever a client meets that was not promised
                if not self.stopping.is_set():
                    self.is_wrong(f"{job.name} of {volume_id}: {type(error).__name__}: {error}")
                client.close()
        client.close()

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
            tree = [self.pid, *descendants(self.pid)]
            memory.append((now, float(sum(map(resident_nbytes, tree)))))
            files.append((now, float(sum(map(descriptors, tree)))))
            time.sleep(SAMPLE_SECONDS)
        return memory, files


def _bare(route: str) -> str:
    return re.sub(r"\{[^}]*\}", "{}", route)
