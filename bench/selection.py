"""Selection: milliseconds to choose the bricks of a view of a volume of 10⁶ bricks, and over HTTP.

    script/bench selection [--quick] [--json FILE]

100 x 100 x 100 bricks of 64³ in S3Dc at 4 bits, and all their coarser levels, of which there are
tables of ranges alone: values fall from the middle outwards. Scenes go from a function that shows
nothing to one that shows all, from afar, from close by and from within, 768 x 768 pixels, with a
budget of 512 MiB. *Select* is the renderer's function by itself; *HTTP* the whole round trip from a
client on loopback, with the answer as JSON. Medians; tables are in memory.
"""

from __future__ import annotations

import json
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

import _measure
import numpy as np
import uvicorn
from numpy.typing import NDArray

from octobrick.codec import S3dc
from octobrick.renderer import Camera, TransferFunction, select
from octobrick.server import Settings, create_app
from octobrick.server.catalog import Catalog
from octobrick.store import LocalVolume
from octobrick.store.box import Zyx

SIDE, BRICK = 100, 64
SIZE = (768, 768)
ROUNDS = 20
WHITE = ((0.0, (1.0, 1.0, 1.0)),)


@dataclass(frozen=True)
class SyntheticLevel:
    """One resolution, without voxels."""

    shape_zyx: Zyx
    grid_zyx: Zyx
    spacing_xyz: tuple[float, float, float]
    origin_xyz: tuple[float, float, float]


class SyntheticVolume:
    """A volume of which there is nothing but what selection reads."""

    nt = nc = 1
    dtype = np.dtype(np.uint8)
    brick_shape_zyx: Zyx = (BRICK,) * 3
    value_range = window = (0.0, 255.0)
    fill_value = 0
    gradients = None

    def __init__(self) -> None:
        self.revision = "0" * 32
        self.levels: list[SyntheticLevel] = []
        self._ranges: list[NDArray[np.uint8]] = []
        z, y, x = np.meshgrid(*[np.linspace(-1, 1, SIDE)] * 3, indexing="ij", sparse=True)
        noise = np.random.default_rng(0).random((SIDE,) * 3)
        value = 255 * np.clip(1 - np.sqrt(x * x + y * y + z * z), 0, 1) * (0.8 + 0.2 * noise)
        low, high = np.floor(value * 0.8).astype(np.uint8), np.ceil(value).astype(np.uint8)
        while True:
            factor, grid = 2.0 ** len(self.levels), low.shape
            shape = tuple(n * BRICK for n in grid)
            origin = ((factor - 1) / 2,) * 3
            level = SyntheticLevel(cast("Zyx", shape), grid, (factor,) * 3, origin)
            self.levels.append(level)
            self._ranges.append(np.stack([low, high], axis=-1))
            if max(grid) == 1:
                break
            low, high = halved(low, np.minimum), halved(high, np.maximum)

    def level_codec(self, _level: int) -> S3dc:
        """Of all levels."""
        return S3dc()

    def ranges(self, level: int, _t: int = 0, _c: int = 0) -> NDArray[np.uint8]:
        """Of each brick."""
        return self._ranges[level]

    def fidelity(self, level: int, _t: int = 0, _c: int = 0) -> NDArray[np.float32]:
        """The same of each brick."""
        return np.ones(self._ranges[level].shape, np.float32)

    def stored_nbytes(
        self, _level: int, bricks_zyx: NDArray[np.intp], _t: int = 0, _c: int = 0
    ) -> NDArray[np.int64]:
        """The same of each brick."""
        return np.full(len(bricks_zyx), 100_000)

    def close(self) -> None:
        """Nothing is open."""


def halved(values: NDArray[np.uint8], extreme: np.ufunc) -> NDArray[np.uint8]:
    """The least or greatest of 2³ each."""
    even = np.pad(values, [(0, n % 2) for n in values.shape], mode="edge")
    z, y, x = (n // 2 for n in even.shape)
    found: NDArray[np.uint8] = extreme.reduce(even.reshape(z, 2, y, 2, x, 2), axis=(1, 3, 5))
    return found


def functions() -> dict[str, TransferFunction]:
    """From what shows nothing to what shows all."""
    above = {
        f"above {v}": TransferFunction(WHITE, ((0.0, 0.0), (v, 0.0), (v + 1.0, 1.0)), "value")
        for v in (200.0, 150.0, 100.0, 50.0)
    }
    nothing = TransferFunction(WHITE, ((0.0, 0.0),))
    return {"nothing": nothing, **above, "all": TransferFunction(WHITE, ((0.0, 1.0),))}


def cameras(volume: SyntheticVolume) -> dict[str, Camera]:
    """From afar, from close by, and from within."""
    far = Camera.orbit(cast("Any", volume), 30, 20)
    within = Camera.look_at((3200.0, 3200.0, 3200.0), (4200.0, 3300.0, 3100.0), fov_degrees=60.0)
    return {"far": far, "near": far.zoomed(8), "within": within}


@contextmanager
def server(volume: SyntheticVolume) -> Iterator[HTTPConnection]:
    """A connection to a server, in a thread, of a volume that is not on a disk."""
    with TemporaryDirectory() as name:
        (Path(name) / "zarr.json").write_text("{}")
        settings = Settings(volumes={"big": Path(name)})
        app = create_app(settings)
        running = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
        thread = threading.Thread(target=running.run)
        thread.start()
        while not running.started:
            time.sleep(0.01)
        app.state.services.catalog = Catalog(
            None, lambda _: cast("LocalVolume", volume), settings.volumes
        )
        try:
            yield HTTPConnection("127.0.0.1", running.servers[0].sockets[0].getsockname()[1])
        finally:
            running.should_exit = True
            thread.join()


def asked(connection: HTTPConnection, camera: Camera, function: TransferFunction) -> None:
    """One question over HTTP, and its answer."""
    view = {
        "eye_world_xyz": camera.eye_world_xyz,
        "target_world_xyz": camera.target_world_xyz,
        "fov_degrees": camera.fov_degrees,
    }
    body = {"camera": view, "transfer_function": json.loads(function.to_json())}
    body |= {"width": SIZE[0], "height": SIZE[1]}
    headers = {"Content-Type": "application/json"}
    connection.request("POST", "/v1/volumes/big/select", json.dumps(body), headers)
    reply = connection.getresponse()
    json.loads(reply.read())
    assert reply.status == 200, reply.status


def median_ms(call: Callable[[], object], rounds: int) -> float:
    """Of some calls after a first one."""
    call()
    took = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        took.append(time.perf_counter() - start)
    return statistics.median(took) * 1e3


def run(_data: Path, quick: bool) -> dict[str, Any]:
    """Milliseconds of each scene."""
    volume, scenes = SyntheticVolume(), []
    source, rounds = cast("Any", volume), 5 if quick else ROUNDS
    with server(volume) as connection:
        for shown, function in functions().items():
            for place, camera in cameras(volume).items():
                found = select(source, camera, SIZE, function)

                def direct(camera: Camera = camera, f: TransferFunction = function) -> object:
                    return select(source, camera, SIZE, f)

                def http(camera: Camera = camera, f: TransferFunction = function) -> None:
                    asked(connection, camera, f)

                scenes.append(
                    {
                        "shown": shown,
                        "camera": place,
                        "level": found.level,
                        "bricks": len(found.bricks_zyx),
                        "select_ms": median_ms(direct, rounds),
                        "http_ms": median_ms(http, rounds),
                    }
                )
    return {"bricks": SIDE**3, "scenes": scenes}


def table(result: dict[str, Any]) -> str:
    """A line for each scene."""
    rows = [
        [
            f"{row['shown']}, {row['camera']}",
            str(row["level"]),
            str(row["bricks"]),
            f"{row['select_ms']:.1f}",
            f"{row['http_ms']:.1f}",
        ]
        for row in result["scenes"]
    ]
    return _measure.layout(["scene", "level", "bricks", "select ms", "HTTP ms"], rows)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
