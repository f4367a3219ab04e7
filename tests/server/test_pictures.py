"""Pictures over HTTP: formats, all words, budgets, progress, replaced volumes, clients."""

from __future__ import annotations

import email
import email.policy
import io
import json
import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from octobrick.codec.errors import CorruptBrickError, InvalidInputError
from octobrick.renderer import Clip, Isosurface, Light, Lighting, Slice
from octobrick.server import Settings, create_app

ErrorOf = Callable[[Any], dict[str, Any]]
RENDER = "/v1/volumes/head/render"
WAIT_SECONDS = 10


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_words_of_the_command_line_mean_the_same_in_a_query_and_in_json(
    client: Any, renderer: Any, data_dir: Path, method: str
) -> None:
    both = {"width": 8, "height": 8, "mode": "dvr", "oriented": False}
    texts = {
        "window": "5,50",
        "clip_box": "0,,,20,20,20",
        "clip_plane": ["0,0,1,-2", "1,0,0,3"],
        "light": ["eye", "1,-1,2:ffcc88"],
        "edges": "0.01,0.1",
        "deblocking": "2.5",
    }
    values = {
        "window": [5, 50],
        "clip_box": [0, None, None, 20, 20, 20],
        "clip_plane": [[0, 0, 1, -2], [1, 0, 0, 3]],
        "light": [{}, {"toward_world_xyz": [1, -1, 2], "color": "ffcc88"}],
        "edges": [0.01, 0.1],
        "deblocking": 2.5,
    }
    if method == "GET":
        reply = client.get(RENDER, params=both | texts)
    else:
        reply = client.post(RENDER, json=both | values)
    assert reply.status_code == 200, reply.text
    (asked,) = renderer.asked
    assert asked["window"] == (5, 50)
    assert asked["clip"] == Clip(
        (0, -math.inf, -math.inf), (20, 20, 20), ((0, 0, 1, -2), (1, 0, 0, 3))
    )
    color = (1, 0xCC / 255, 0x88 / 255)
    assert asked["shading"] == Lighting(lights=(Light(), Light((1, -1, 2), color)))
    assert asked["edges"] == (0.01, 0.1)
    assert asked["deblocking"] == 2.5


def test_surfaces_and_cuts_have_their_words(client: Any, renderer: Any) -> None:
    small = {"width": 8, "height": 8}
    surface = small | {"mode": "isosurface", "iso": 900, "iso_opacity": 0.5}
    assert client.get(RENDER, params=surface).status_code == 200
    assert renderer.asked[-1]["mode"] == Isosurface(900, 0.5)
    cut = small | {"mode": "slice", "slice_normal": "0,0,1", "slice_point": "1,2,3"}
    assert client.get(RENDER, params=cut).status_code == 200
    assert renderer.asked[-1]["mode"] == Slice((1, 2, 3), (0, 0, 1))


@pytest.mark.parametrize(
    ("field", "question"),
    [
        ("iso", {"mode": "isosurface"}),
        ("iso", {"iso": "5"}),
        ("mode", {"slice_point": "1,2,3"}),
        ("slice_normal", {"mode": "slice", "slice_normal": "1,2"}),
        ("clip_box", {"clip_box": "1,2,3"}),
        ("clip_plane", {"clip_plane": "x,0,0,1"}),
        ("clip_plane", {"clip_plane": ["0,0,1,0"] * 13}),
        ("light", {"light": "1,2"}),
        ("light", {"light": ["eye"] * 5}),
        ("edges", {"edges": "nan,1"}),
        ("c", {"c": "0,1,2,3,4"}),
        ("c", {"c": "-1"}),
        ("deblocking", {"deblocking": "much"}),
        ("legend", {"legend": "true", "c": "0,1"}),
        ("format", {"format": "gif"}),
        ("quality", {"format": "jpeg", "quality": "0"}),
        ("quality", {"format": "png", "quality": "50"}),
        ("background", {"format": "jpeg", "background": "transparent"}),
        ("timeout_seconds", {"timeout_seconds": "0"}),
        ("budget_nbytes", {"budget_nbytes": "0"}),
    ],
)
def test_words_that_make_no_sense_are_422_before_anything_waits(
    client: Any, renderer: Any, error_of: ErrorOf, field: str, question: dict[str, Any]
) -> None:
    reply = client.get(RENDER, params=question)
    assert reply.status_code == 422, reply.text
    assert str(error_of(reply)["facts"]["field"]).split(".")[0] == field
    assert renderer.asked == []


@pytest.mark.parametrize(
    ("question", "accept", "kind"),
    [
        ({}, "*/*", "PNG"),
        ({}, "image/webp", "WEBP"),
        ({}, "image/png;q=0.5, image/jpeg;q=0.9", "JPEG"),
        ({}, "image/avif,image/webp,image/*,*/*;q=0.8", "PNG"),
        ({}, "text/html", "PNG"),
        ({"background": "transparent"}, "image/jpeg", "PNG"),
        ({"format": "webp"}, "image/png", "WEBP"),
        ({"format": "webp", "quality": "10"}, "", "WEBP"),
        ({"format": "jpeg", "quality": "80"}, "", "JPEG"),
    ],
)
def test_format_is_the_one_asked_for_or_that_of_the_accept_header(
    client: Any, question: dict[str, str], accept: str, kind: str
) -> None:
    size = {"width": "16", "height": "8"}
    reply = client.get(RENDER, params=size | question, headers={"accept": accept})
    assert reply.headers["content-type"] == f"image/{kind.lower()}"
    assert (reply.headers.get("vary") == "Accept") is ("format" not in question)
    picture = Image.open(io.BytesIO(reply.content))
    assert (picture.format, picture.size) == (kind, (16, 8))
    if "quality" not in question and kind != "JPEG":
        assert picture.convert("RGB").getpixel((0, 0)) == (10, 20, 30)


def test_another_format_has_another_etag(client: Any) -> None:
    etags = {
        client.get(RENDER, params={"width": 8, "height": 8}, headers={"accept": accept}).headers[
            "etag"
        ]
        for accept in ("image/png", "image/webp")
    }
    assert len(etags) == 2


@pytest.mark.parametrize(
    ("word", "limit_name"),
    [
        ({"budget_nbytes": 536_870_913}, "render_memory_budget_nbytes"),
        ({"timeout_seconds": 61}, "render_timeout_seconds"),
    ],
)
def test_a_request_may_lower_limits_and_not_raise_them(
    client: Any, error_of: ErrorOf, word: dict[str, int], limit_name: str
) -> None:
    reply = client.get(RENDER, params=word)
    assert reply.status_code == 413
    assert error_of(reply)["facts"]["limit_name"] == limit_name


def test_a_lower_budget_shows_a_coarser_level_or_refuses_the_one_named(
    client: Any, renderer: Any, error_of: ErrorOf
) -> None:
    words = {"width": 600, "height": 600, "fit": "volume", "preset": "microscopy"}
    words |= {"shading": "false"}  # or the directions of level 1 take more than all of level 0
    assert client.get(RENDER, params=words | {"budget_nbytes": 10**8}).status_code == 200
    assert client.get(RENDER, params=words | {"budget_nbytes": 20_000}).status_code == 200
    assert [asked["level"] for asked in renderer.asked] == [0, 1]
    reply = client.get(RENDER, params=words | {"budget_nbytes": 20_000, "level": 0})
    assert reply.status_code == 413
    assert error_of(reply)["kind"] == "view-too-large"


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_progressive_picture_comes_coarse_and_then_final(
    client: Any, renderer: Any, revision: str, method: str
) -> None:
    words = {"width": 300, "height": 150, "progressive": True, "scale_bar": True}
    options = {"params": words} if method == "GET" else {"json": words}
    reply = client.request(method, RENDER, **options)
    assert reply.status_code == 200
    assert reply.headers["cache-control"] == "no-store"
    assert "etag" not in reply.headers
    assert reply.headers["content-type"].startswith("multipart/x-mixed-replace; boundary=")
    coarse, again, final = parts_of(reply)
    assert again.as_bytes() == coarse.as_bytes()  # without it Chromium does not show the first
    for part in (coarse, final):
        assert part["content-type"] == "image/png"
        assert part["x-octobrick-revision"] == revision
        assert Image.open(io.BytesIO(part.get_payload(decode=True))).size == (300, 150)
    assert (coarse["x-octobrick-converged"], final["x-octobrick-converged"]) == ("false", "true")
    first, second = renderer.asked
    assert (first["size"], first["level"]) == ((128, 64), 2)
    assert (second["size"], second["level"]) == ((300, 150), None)


def parts_of(reply: Any) -> list[Any]:
    """The parts of a multipart reply, as a reader of mail has them."""
    head = f"content-type: {reply.headers['content-type']}\r\n\r\n".encode()
    message = email.message_from_bytes(head + reply.content, policy=email.policy.HTTP)
    assert not message.defects
    return list(message.iter_parts())


def test_errors_before_the_first_part_are_ordinary_and_later_ones_are_the_last_part(
    client: Any, renderer: Any, error_of: ErrorOf
) -> None:
    question = {"params": {"width": 8, "height": 8, "progressive": True}}
    renderer.fails_with = InvalidInputError("c 7: there are 0 to 0")
    assert error_of(client.get(RENDER, **question))["kind"] == "invalid-input"
    renderer.fails_with = None
    calls: list[int] = []

    def fail_the_second_time() -> None:
        calls.append(1)
        if len(calls) == 2:
            raise CorruptBrickError("damaged: /srv/head.zarr", path="/srv/head.zarr")

    renderer.before = fail_the_second_time
    picture, _, error = parts_of(client.get(RENDER, **question))
    assert picture["content-type"] == "image/png"
    assert error["content-type"] == "application/json"
    assert json.loads(error.get_payload(decode=True))["error"]["kind"] == "corrupt-brick"
    assert "srv" not in error.get_payload()


def test_a_volume_replaced_during_a_picture_is_rendered_anew(
    client: Any, renderer: Any, revision: str, replace_volume: Callable[[str], None]
) -> None:
    replaced: list[int] = []

    def replace_once() -> None:
        if not replaced:
            replaced.append(1)
            replace_volume("head")

    renderer.before = replace_once
    reply = client.get(RENDER, params={"width": 8, "height": 8})
    assert reply.status_code == 200
    assert len(renderer.asked) == 2
    assert reply.headers["x-octobrick-revision"] != revision
    renderer.before = lambda: replace_volume("head")
    reply = client.get(RENDER, params={"width": 9, "height": 8})
    assert (reply.status_code, reply.json()["error"]["kind"]) == (503, "volume-replaced")


def test_a_server_without_workers_says_that_it_renders_nothing(
    data_dir: Path, renderer: Any, make_client: Any, error_of: ErrorOf
) -> None:
    app = create_app(Settings(data_dir=data_dir, render_workers=0))
    with make_client(app) as client:
        reply = client.get(RENDER)
        assert reply.status_code == 501
        assert error_of(reply)["kind"] == "rendering-off"
        assert "retry-after" not in reply.headers


def test_clients_are_told_apart_by_their_names(
    data_dir: Path, renderer: Any, gate: Any, wait_until: Any, make_client: Any, error_of: ErrorOf
) -> None:
    tokens = [{"name": n, "sha256": sha256(n.encode()).hexdigest()} for n in ("a", "b")]
    tokens_file = data_dir / "tokens.json"
    tokens_file.write_text(json.dumps([token | {"volumes": ["*"]} for token in tokens]))
    settings = Settings(data_dir=data_dir, tokens_file=tokens_file, render_queue_per_client=1)
    app = create_app(settings, make_renderer=lambda: renderer)
    stats = app.state.services
    with make_client(app) as client, ThreadPoolExecutor(4) as clients:

        def ask(name: str) -> Any:
            headers = {"authorization": f"Bearer {name}"}
            return client.get(RENDER, params={"width": 8, "height": 8}, headers=headers)

        running = clients.submit(ask, "a")
        assert gate.reached.wait(WAIT_SECONDS)
        waiting = [clients.submit(ask, "a"), clients.submit(ask, "b")]
        wait_until(lambda: stats.renders.stats()["waiting"] == 2)
        refused = ask("a")
        assert refused.status_code == 503
        assert error_of(refused)["facts"]["limit_name"] == "render_queue_per_client"
        gate.open()
        assert [reply.result(WAIT_SECONDS).status_code for reply in [running, *waiting]] == [
            200
        ] * 3
