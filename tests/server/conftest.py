"""A small folder of volumes, an app that serves it, and a renderer that needs no OpenGL."""

from __future__ import annotations

import contextlib
import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import anyio.from_thread
import httpx
import numpy as np
import pytest
from fastapi import FastAPI

from octobrick.codec import S3dc
from octobrick.renderer import Fidelity, RenderedImage, RenderStats
from octobrick.server import Settings, create_app
from octobrick.server.services import Services
from octobrick.store import LocalVolume, ingest, open_volume

WAIT_SECONDS = 10  # only a failing test waits as long


class FakeRenderer:
    """Answers at once with a picture of one colour, and remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[dict[str, Any]] = []
        self.fails_with: Exception | None = None
        self.before: Callable[[], None] = lambda: None

    def render(self, volume: Any, camera: Any, transfer_function: Any, **options: Any) -> Any:
        self.before()
        if self.fails_with:
            raise self.fails_with
        asked = {"camera": camera, "transfer_function": transfer_function, **options}
        self.asked.append(asked)
        return _picture(*options["size"], opaque=options["background"] is not None)

    def close(self) -> None:
        pass


class Client:
    """Calls an app that runs in an event loop of its own. Safe to use from several threads."""

    def __init__(self, app: FastAPI, portal: anyio.from_thread.BlockingPortal) -> None:
        self.app = app
        self._portal = portal
        # An unexpected error must come back as an answer here, as it does over a socket.
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        self._client = httpx.AsyncClient(transport=transport, base_url="http://test")
        self._client.headers.clear()
        self._client.headers["x-request-id"] = "test"  # or no two answers would be equal

    def request(self, method: str, path: str, **options: Any) -> httpx.Response:
        """One request and its answer, with the content decoded by its Content-Encoding."""

        async def call() -> httpx.Response:
            return await self._client.request(method, path, **options)

        return self._portal.call(call)

    def get(self, path: str, **options: Any) -> httpx.Response:
        """A GET request."""
        return self.request("GET", path, **options)

    def post(self, path: str, **options: Any) -> httpx.Response:
        """A POST request."""
        return self.request("POST", path, **options)


def _picture(width: int, height: int, *, opaque: bool) -> RenderedImage:
    """One colour, and on the right another one."""
    rgba = np.full((height, width, 4), (10, 20, 30, 255), np.uint8)
    rgba[:, width // 2 :] = (200, 100, 50, 255 if opaque else 128)
    stats = RenderStats(1, {}, 1, 1, 0, 70, 0, 30, 1, 1, (0, 1), {"cast": 2, "total": 5}, "fake")
    return RenderedImage(
        rgba, np.zeros((height, width, 4), np.float32), Fidelity(1, 0, 12.5, True), stats
    )


def ramp(seed: int = 0) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """40 x 36 x 50 voxels that rise along every axis, the last brick of 16 empty."""
    z, y, x = np.ogrid[:40, :36, :50]
    voxels = (19 * z + 31 * y + 47 * x + seed).astype(np.uint16)  # no two bricks are alike
    voxels[32:, 32:, 48:] = 0
    return np.asarray(voxels)


@pytest.fixture(scope="session")
def volumes_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A compressed, a lossless and a broken volume, and things that are none."""
    folder = tmp_path_factory.mktemp("volumes")
    source = folder / "ramp.npy"
    np.save(source, ramp())
    ingest(source, folder / "head.zarr", codec=S3dc(), brick=16, workers=1, gradients=True)
    ingest(source, folder / "exact.zarr", codec=None, brick=16, workers=1)
    (folder / "torn.zarr").mkdir()
    (folder / "torn.zarr" / "zarr.json").write_text("{")
    (folder / "plain.zarr").mkdir()
    (folder / ".hidden.zarr").mkdir()
    return folder


@pytest.fixture
def data_dir(volumes_template: Path, tmp_path: Path) -> Path:
    """A copy of the volumes that a test may change."""
    return Path(shutil.copytree(volumes_template, tmp_path / "volumes"))


@pytest.fixture
def replace_volume(data_dir: Path) -> Callable[[str], None]:
    """Put other voxels in the place of a volume, as `octobrick ingest --overwrite` does."""

    def replace(volume_id: str) -> None:
        source = data_dir / "other.npy"
        np.save(source, ramp(seed=7))
        ingest(source, data_dir / f"{volume_id}.zarr", brick=16, workers=1, overwrite=True)

    return replace


@pytest.fixture
def renderer() -> FakeRenderer:
    return FakeRenderer()


class Gate:
    """Holds a renderer until it is opened."""

    def __init__(self, renderer: FakeRenderer) -> None:
        self.reached, self._open = threading.Event(), threading.Event()
        renderer.before = self._hold

    def _hold(self) -> None:
        self.reached.set()
        assert self._open.wait(WAIT_SECONDS)

    def open(self) -> None:
        self._open.set()


@pytest.fixture
def gate(renderer: FakeRenderer) -> Gate:
    """Every picture waits until this is opened."""
    return Gate(renderer)


@pytest.fixture
def wait_until() -> Callable[[Callable[[], bool]], None]:
    """Wait for something to hold, without guessing how long it takes."""

    def wait(holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + WAIT_SECONDS
        while not holds():
            assert time.monotonic() < deadline
            time.sleep(0.005)

    return wait


@pytest.fixture
def app(data_dir: Path, renderer: FakeRenderer) -> FastAPI:
    settings = Settings(
        warm_start=False,  # what the tests count is theirs
        data_dir=data_dir,
        max_image_side=1024,
        max_image_pixels=768 * 1024,
        max_body_nbytes=4096,
    )
    return create_app(settings, make_renderer=lambda: renderer)  # type: ignore[arg-type,return-value]


@contextlib.contextmanager
def running(app: FastAPI) -> Iterator[Client]:
    """A client of an app whose lifespan has started."""
    with (
        anyio.from_thread.start_blocking_portal() as portal,
        portal.wrap_async_context_manager(app.router.lifespan_context(app)),
    ):
        yield Client(app, portal)


@pytest.fixture
def make_client() -> Callable[[FastAPI], contextlib.AbstractContextManager[Client]]:
    return running


@pytest.fixture
def client(app: FastAPI) -> Iterator[Client]:
    with running(app) as client:
        yield client


@pytest.fixture
def revision(client: Client) -> str:
    """The revision of the volume `head`."""
    return str(client.get("/v1/volumes/head").json()["revision"])


@pytest.fixture
def error_of() -> Callable[[Any], dict[str, Any]]:
    """The error in a reply, checked for the one shape that all have."""

    def read(reply: Any) -> dict[str, Any]:
        assert reply.status_code >= 400, reply.text
        assert reply.headers["content-type"] == "application/json"
        assert reply.headers["x-content-type-options"] == "nosniff"
        body = json.loads(reply.content)
        assert set(body) == {"error"}
        assert set(body["error"]) == {"kind", "message", "facts"}
        error: dict[str, Any] = body["error"]
        return error

    return read


@pytest.fixture
def base(revision: str) -> str:
    """What the addresses of bricks of the volume `head` begin with."""
    return f"/v1/volumes/head/{revision}"


@pytest.fixture
def services(app: FastAPI, client: Any) -> Services:
    services: Services = app.state.services
    return services


@pytest.fixture
def head(data_dir: Path) -> LocalVolume:
    return open_volume(data_dir / "head.zarr")
