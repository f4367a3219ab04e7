"""Pictures over HTTP, with a renderer that needs no OpenGL: words, limits, caching, waiting."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.renderer import (
    Camera,
    Clip,
    GraphicsContextError,
    PictureTooLargeError,
    TransferFunction,
    visible_bounds,
)
from octobrick.server import Settings, create_app
from octobrick.server.views.view import parse_background, parse_window
from octobrick.store import open_volume

ErrorOf = Callable[[Any], dict[str, Any]]
RENDER = "/v1/volumes/head/render"
WAIT_SECONDS = 10


def test_picture_is_a_png_with_what_is_known_of_it(
    client: Any, revision: str, data_dir: Path
) -> None:
    reply = client.get(RENDER, params={"width": 96, "height": 64})
    assert reply.status_code == 200
    assert reply.headers["content-type"] == "image/png"
    assert Image.open(io.BytesIO(reply.content)).size == (96, 64)
    assert reply.headers["x-octobrick-revision"] == revision
    assert reply.headers["x-octobrick-level"] == "1"
    assert reply.headers["x-octobrick-max-error"] == "12.5"
    assert reply.headers["x-octobrick-converged"] == "true"
    names = [part.split(";dur=")[0] for part in reply.headers["server-timing"].split(", ")]
    assert names == ["queue", "open", "render", "encode", "render-cast"]


def test_defaults_are_those_of_the_command_line(client: Any, renderer: Any, data_dir: Path) -> None:
    assert client.post(RENDER, json={"width": 8, "height": 8}).status_code == 200
    assert client.get(RENDER, params={"width": 8, "height": 8}).status_code == 200
    posted, got = renderer.asked
    assert posted == got
    with open_volume(data_dir / "head.zarr") as volume:
        bounds = visible_bounds(volume, TransferFunction.preset("ct-bone"))
        assert got["camera"] == Camera.orbit(volume, 30, 15, bounds=bounds)
    assert got["transfer_function"] == TransferFunction.preset("ct-bone")
    del got["camera"], got["transfer_function"]
    assert got == {
        "size": (8, 8),
        "mode": "dvr",
        "window": None,
        "shading": True,
        "gradients": "auto",
        "edges": None,
        "deblocking": False,
        "clip": Clip(),
        "background": (0.0, 0.0, 0.0),
        "step_voxels": 0.5,
        "level": None,
        "t": 0,
        "c": 0,
        "rgb": False,
        "depth": False,
        "direct": None,
    }


def test_every_word_of_a_query_reaches_the_renderer(
    client: Any, renderer: Any, data_dir: Path
) -> None:
    query = (
        "azimuth=10&elevation=-20&distance=300&fov=45&fit=volume&projection=orthographic&preset=mr&width=20"
        "&height=10&window=5,50.5&shading=false&background=ff8000&step_voxels=1.5&level=2&t=0&c=0"
        "&mode=mip&gradients=differences&deblocking=true"
    )
    assert client.get(f"{RENDER}?{query}").status_code == 200
    (asked,) = renderer.asked
    with open_volume(data_dir / "head.zarr") as volume:
        assert asked["camera"] == Camera.orbit(volume, 10, -20, 300, 45).orthographic()
    assert asked["transfer_function"] == TransferFunction.preset("mr")
    assert asked["size"] == (20, 10)
    assert asked["window"] == (5, 50.5)
    assert asked["shading"] is False
    assert asked["background"] == pytest.approx((1, 128 / 255, 0))
    assert (asked["step_voxels"], asked["level"]) == (1.5, 2)
    assert (asked["mode"], asked["gradients"], asked["deblocking"]) == ("mip", "differences", True)


def test_a_transfer_function_of_ones_own_is_used(client: Any, renderer: Any) -> None:
    function = TransferFunction.preset("microscopy")
    body = {"width": 8, "height": 8, "transfer_function": json.loads(function.to_json())}
    assert client.post(RENDER, json=body).status_code == 200
    assert renderer.asked[0]["transfer_function"] == function


def test_same_question_has_the_same_etag_and_304_without_rendering(
    client: Any, renderer: Any, replace_volume: Callable[[str], None]
) -> None:
    first = client.get(RENDER, params={"width": 8, "height": 8})
    etag = first.headers["etag"]
    assert etag.startswith('W/"')
    assert first.headers["cache-control"] == "no-cache"
    again = {"params": {"height": 8, "width": 8}, "headers": {"if-none-match": etag}}
    reply = client.get(RENDER, **again)
    assert (reply.status_code, reply.content, reply.headers["etag"]) == (304, b"", etag)
    assert len(renderer.asked) == 1
    other = client.get(RENDER, params={"width": 8, "height": 8, "azimuth": 31})
    assert other.headers["etag"] != etag
    replace_volume("head")
    assert client.get(RENDER, **again).status_code == 200


def test_with_a_revision_the_picture_is_for_ever_or_gone(
    client: Any, revision: str, error_of: ErrorOf, replace_volume: Callable[[str], None]
) -> None:
    question = {"width": 8, "height": 8, "revision": revision}
    assert "immutable" in client.get(RENDER, params=question).headers["cache-control"]
    assert client.post(RENDER, json=question).status_code == 200
    replace_volume("head")
    for reply in (client.get(RENDER, params=question), client.post(RENDER, json=question)):
        assert reply.status_code == 410
        assert error_of(reply)["kind"] == "revision-gone"


@pytest.mark.parametrize(
    ("size", "limit_name", "limit", "value"),
    [
        ({"width": 100_000}, "max_image_side", 1024, 100_000),
        ({"height": 10**30}, "max_image_side", 1024, 10**30),
        ({"width": 1024, "height": 769}, "max_image_pixels", 1024 * 768, 1024 * 769),
    ],
)
def test_huge_picture_is_413_with_the_limit_and_both_values(
    client: Any,
    renderer: Any,
    error_of: ErrorOf,
    size: dict[str, int],
    limit_name: str,
    limit: int,
    value: int,
) -> None:
    question = {"width": 8, "height": 8} | size
    for reply in (client.get(RENDER, params=question), client.post(RENDER, json=question)):
        assert reply.status_code == 413
        error = error_of(reply)
        assert error["kind"] == "too-large"
        assert error["facts"] == {"limit_name": limit_name, "limit": limit, "value": value}
    assert renderer.asked == []


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("width", "0"),
        ("height", "-5"),
        ("width", "9" * 5000),
        ("azimuth", "nan"),
        ("azimuth", "inf"),
        ("elevation", "91"),
        ("distance", "0"),
        ("fov", "180"),
        ("projection", "fisheye"),
        ("window", "5"),
        ("window", "5,1"),
        ("window", "nan,1"),
        ("window", "-1e308,1e308"),
        ("preset", "no-such-preset"),
        ("background", "pink"),
        ("background", "0,0,1.5"),
        ("step_voxels", "1e-9"),
        ("level", "-1"),
        ("t", "x"),
        ("no_such_word", "1"),
    ],
)
def test_senseless_query_is_422_and_names_the_word(
    client: Any, renderer: Any, error_of: ErrorOf, field: str, value: str
) -> None:
    reply = client.get(RENDER, params={field: value})
    assert reply.status_code == 422
    error = error_of(reply)
    assert error["kind"] == "invalid-input"
    assert error["facts"]["field"] == field
    assert renderer.asked == []


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b'{"width": NaN}',
        b'{"width": 1e999}',
        b'{"window": [1]}',
        b'{"window": [2, 1]}',
        b'{"transfer_function": {}}',
        b'{"transfer_function": {"opacity": "deep"}}',
        b'{"preset": "no-such-preset"}',
        b"\xff\xfe",
        b'{"preset": "\\ud800"}',
        b'{"\\ud800": 1}',
        b"[" * 4000,
    ],
)
def test_senseless_body_is_422(client: Any, error_of: ErrorOf, body: bytes) -> None:
    reply = client.post(RENDER, content=body, headers={"content-type": "application/json"})
    assert reply.status_code == 422, reply.text
    assert error_of(reply)["kind"] == "invalid-input"


@pytest.mark.parametrize(
    ("raised", "status", "kind", "retries"),
    [
        (GraphicsContextError("no EGL; apt-get install libegl1"), 503, "no-graphics", True),
        (PictureTooLargeError("not even a thin slab fits"), 413, "view-too-large", False),
        (InvalidInputError("level 7 does not exist"), 422, "invalid-input", False),
        (CorruptBrickError("checksum mismatch"), 500, "corrupt-brick", False),
        (RuntimeError("the driver crashed"), 500, "internal", False),
    ],
)
def test_what_the_renderer_raises_is_answered_and_the_rest_is_served(
    client: Any,
    renderer: Any,
    error_of: ErrorOf,
    raised: Exception,
    status: int,
    kind: str,
    retries: bool,
) -> None:
    renderer.fails_with = raised
    reply = client.get(RENDER)
    assert reply.status_code == status
    assert error_of(reply)["kind"] == kind
    assert ("retry-after" in reply.headers) is retries
    assert client.get("/v1/volumes/head").status_code == 200
    renderer.fails_with = None
    assert client.get(RENDER, params={"width": 8, "height": 8}).status_code == 200


def test_unknown_volume_is_404_before_anything_waits(
    client: Any, renderer: Any, error_of: ErrorOf
) -> None:
    for reply in (
        client.get("/v1/volumes/tail/render"),
        client.post("/v1/volumes/tail/render", json={}),
    ):
        assert reply.status_code == 404
        assert error_of(reply)["kind"] == "volume-not-found"


def test_too_many_pictures_at_once_are_503_and_bricks_go_on(
    data_dir: Path, renderer: Any, gate: Any, wait_until: Any, make_client: Any, error_of: ErrorOf
) -> None:
    app = create_app(
        Settings(data_dir=data_dir, render_queue_length=1),
        make_renderer=lambda: renderer,
    )
    with make_client(app) as client, ThreadPoolExecutor(2) as clients:
        running = clients.submit(client.get, RENDER, params={"width": 8, "height": 8})
        assert gate.reached.wait(WAIT_SECONDS)
        waiting = clients.submit(client.get, RENDER, params={"width": 8, "height": 8})
        wait_until(lambda: app.state.services.renders.stats()["waiting"] == 1)
        refused = client.get(RENDER)
        assert refused.status_code == 503
        assert error_of(refused)["kind"] == "busy"
        assert int(refused.headers["retry-after"]) > 0
        detail = client.get("/v1/volumes/head").json()
        brick = detail["bricks"].format(level=0, t=0, c=0, z=0, y=0, x=0)
        assert client.get(brick).status_code == 200
        gate.open()
        assert running.result(WAIT_SECONDS).status_code == 200
        assert waiting.result(WAIT_SECONDS).status_code == 200


def test_a_picture_that_takes_too_long_is_503_and_one_that_waited_is_never_begun(
    data_dir: Path, renderer: Any, gate: Any, make_client: Any, error_of: ErrorOf
) -> None:
    app = create_app(
        Settings(data_dir=data_dir, render_timeout_seconds=0.05),
        make_renderer=lambda: renderer,
    )
    with make_client(app) as client:
        for _ in range(2):  # the first one is being rendered, the second one waits behind it
            reply = client.get(RENDER, params={"width": 8, "height": 8})
            assert reply.status_code == 503
            assert error_of(reply)["kind"] == "render-timeout"
            assert int(reply.headers["retry-after"]) > 0
        gate.open()
    assert len(renderer.asked) == 1


def test_background_as_text() -> None:
    assert parse_background("#ff0000") == (1, 0, 0)
    assert parse_background("0,0.5,1") == (0, 0.5, 1)
    assert parse_background("transparent") is None


def test_window_as_text() -> None:
    assert parse_window("-100,900.5") == (-100, 900.5)


def test_a_camera_of_ones_own_is_the_one_that_is_used(client: Any, renderer: Any) -> None:
    camera = {"eye_world_xyz": [1, -90, 5], "target_world_xyz": [20, 20, 20], "height_world": 30}
    reply = client.post(RENDER, json={"width": 8, "height": 8, "camera": camera})
    assert reply.status_code == 200
    assert renderer.asked[-1]["camera"] == Camera(
        (1, -90, 5), (20, 20, 20), fov_degrees=None, height_world=30
    )
    blind = camera | {"eye_world_xyz": [20, 20, 20]}
    assert client.post(RENDER, json={"camera": blind}).status_code == 422
