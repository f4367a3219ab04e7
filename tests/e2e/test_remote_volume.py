"""A volume on the real server, over a real socket: the same bricks, pictures and lines of text."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from octobrick.renderer import Camera, Renderer, TransferFunction
from octobrick.server import Settings, create_app
from octobrick.server.cli import main
from octobrick.store import ingest, open_volume


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("served")
    z, y, x = np.indices((60, 70, 80))
    distance = np.sqrt((z - 30) ** 2 + (y - 35) ** 2 + (x - 40) ** 2)
    np.save(folder / "ball.npy", np.clip(250 - 8 * distance, 0, 250).astype(np.uint8))
    ingest(folder / "ball.npy", folder / "ball.zarr", brick=16, shard=2, gradients=True)
    return folder


@pytest.fixture(scope="module")
def url(folder: Path) -> Iterator[str]:
    import uvicorn

    app = create_app(Settings(data_dir=folder))
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        thread.join(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    yield f"http://127.0.0.1:{port}/v1/volumes/ball"
    server.should_exit = True
    thread.join(10)


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OCTOBRICK_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("OCTOBRICK_TOKEN", raising=False)


@pytest.mark.gl
@pytest.mark.parametrize("wait", [True, False])
@pytest.mark.parametrize(("level", "gradients"), [(0, "differences"), (1, "stored")])
def test_the_renderer_draws_the_same_picture_through_it(
    folder: Path, url: str, wait: bool, level: int, gradients: str
) -> None:
    pictures = []
    for where in (folder / "ball.zarr", url):
        with open_volume(where) as volume, Renderer("64MiB", decode="cpu") as renderer:
            camera = Camera.orbit(volume, 30, 20)
            function = TransferFunction.preset("ct-soft-tissue")
            while True:
                image = renderer.render(
                    volume,
                    camera,
                    function,
                    (64, 48),
                    wait=wait,
                    level=level,
                    gradients=gradients,
                )
                if not image.stats.bricks["substituted"]:
                    break
                renderer.wait_for_arrivals(0.05)
            pictures.append(image)
    np.testing.assert_array_equal(pictures[0].premultiplied, pictures[1].premultiplied)
    assert pictures[0].fidelity == pictures[1].fidelity


def test_a_whole_batch_equals_the_volume_on_disk(folder: Path, url: str) -> None:
    with open_volume(folder / "ball.zarr") as local, open_volume(url) as remote:
        places = [(0, tuple(zyx), 0, 0) for zyx in np.ndindex(*local.levels[0].grid_zyx)]
        came = dict(iter(remote.brick_codes(places)))
        assert [came[i] for i in range(len(places))] == [local.brick_code(*p) for p in places]
        np.testing.assert_array_equal(remote.ranges(0), local.ranges(0))
        assert remote.metadata() == local.metadata()


def test_stored_gradients_equal_those_on_disk_one_by_one_and_together(
    folder: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCTOBRICK_CACHE_NBYTES", "0")  # each way asks the server
    with open_volume(folder / "ball.zarr") as local, open_volume(url) as remote:
        assert remote.gradients.levels == local.gradients.levels == (1, 2, 3)
        for level in local.gradients.levels:
            grid_zyx = local.levels[level].grid_zyx
            places = [(level, tuple(zyx), 0, 0) for zyx in np.ndindex(*grid_zyx)]
            stored = [local.gradients.stored_brick(*place) for place in places]
            assert any(stored)
            assert [remote.gradients.stored_brick(*place) for place in places] == stored
            codes = [local.gradients.code(*place) for place in places]
            assert [remote.gradients.code(*place) for place in places] == codes
            assert dict(iter(remote.gradients.brick_codes(places))) == dict(enumerate(codes))
            np.testing.assert_array_equal(remote.gradients.read(level), local.gradients.read(level))


def test_commands_take_the_address_as_they_take_the_folder(
    folder: Path, url: str, tmp_path: Path
) -> None:
    outputs = []
    for number, where in enumerate((str(folder / "ball.zarr"), url)):
        out = tmp_path / f"{number}.npy"
        assert CliRunner().invoke(main, ["export", where, str(out), "--quiet"]).exit_code == 0
        told = CliRunner().invoke(main, ["info", where, "--json"])
        outputs.append((out.read_bytes(), json.loads(told.stdout)))
    assert outputs[0] == outputs[1]


def test_what_a_server_cannot_do_is_one_line(url: str, tmp_path: Path) -> None:
    unknown = url.replace("ball", "none")
    for arguments, kind in (
        (["verify", url], "unsupported"),
        (["info", unknown], "volume-not-found"),
        (["export", unknown, str(tmp_path / "x.npy")], "volume-not-found"),
    ):
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code in (1, 2)
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"octobrick: error [{kind}]: ")
