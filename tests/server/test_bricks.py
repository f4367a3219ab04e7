"""One brick over HTTP: bytes, encodings, caching, and what is wrong with an address."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from octobrick.server.bricks.brick_lane import parse_brick_path
from octobrick.server.reply import accepts_zstd, matches_etag
from octobrick.store import Volume, open_volume

ErrorOf = Callable[[Any], dict[str, Any]]


@pytest.fixture
def base(revision: str) -> str:
    return f"/v1/volumes/head/{revision}/bricks"


@pytest.fixture
def head(data_dir: Path) -> Volume:
    return open_volume(data_dir / "head.zarr")


def test_client_that_takes_zstd_gets_the_stored_frame(client: Any, base: str, head: Volume) -> None:
    reply = client.get(f"{base}/0/0/0/1/0/2", headers={"accept-encoding": "gzip, zstd"})
    assert reply.status_code == 200
    assert reply.headers["content-encoding"] == "zstd"
    stored = head.stored_brick(0, (1, 0, 2))
    assert stored is not None
    assert reply.headers["content-length"] == str(len(stored))
    assert reply.content == head.brick_code(0, (1, 0, 2))  # as httpx decoded it


@pytest.mark.parametrize("headers", [{}, {"accept-encoding": "gzip"}])
def test_any_other_client_gets_the_code_without_zstd(
    client: Any, base: str, head: Volume, headers: dict[str, str]
) -> None:
    reply = client.get(f"{base}/0/0/0/1/0/2", headers=headers)
    assert reply.status_code == 200
    assert "content-encoding" not in reply.headers
    assert reply.content == head.brick_code(0, (1, 0, 2))
    assert reply.headers["content-length"] == str(len(reply.content))


def test_headers_say_what_the_bytes_are_and_how_far_to_trust_them(
    client: Any, base: str, head: Volume
) -> None:
    headers = client.get(f"{base}/1/0/0/0/1/1").headers
    low, high = head.ranges(1)[0, 1, 1]
    max_error, rmse = head.fidelity(1)[0, 1, 1]
    assert max_error > 0
    assert headers["content-type"] == "application/octet-stream"
    assert headers["cache-control"] == "public, max-age=31536000, immutable"
    assert headers["vary"] == "Accept-Encoding"
    assert headers["x-octobrick-codec"] == "s3dc; block=8,8,8; bits=4"
    assert headers["x-octobrick-dtype"] == "uint16"
    assert headers["x-octobrick-shape"] == "16,16,16"
    assert headers["x-octobrick-range"] == f"{low},{high}"
    assert float(headers["x-octobrick-max-error"]) == pytest.approx(max_error, rel=1e-5)
    assert float(headers["x-octobrick-rmse"]) == pytest.approx(rmse, rel=1e-5)


def test_lossless_brick_is_raw_voxels(client: Any, data_dir: Path) -> None:
    address = client.get("/v1/volumes/exact").json()["bricks"]
    reply = client.get(address.format(level=0, t=0, c=0, z=2, y=2, x=2))
    assert reply.headers["x-octobrick-codec"] == "raw"
    assert reply.headers["x-octobrick-max-error"] == "0"
    with open_volume(data_dir / "exact.zarr") as volume:
        assert reply.content == volume.brick(0, (2, 2, 2)).tobytes()


def test_absent_brick_is_204_and_can_be_kept(client: Any, base: str, head: Volume) -> None:
    assert head.stored_brick(0, (2, 2, 3)) is None
    reply = client.get(f"{base}/0/0/0/2/2/3")
    assert reply.status_code == 204
    assert reply.content == b""
    assert "immutable" in reply.headers["cache-control"]
    assert reply.headers["x-octobrick-shape"] == "16,16,16"


def test_each_encoding_has_its_own_strong_etag_and_304(client: Any, base: str) -> None:
    encodings = {"zstd": {"accept-encoding": "zstd"}, "identity": {}}
    etags = {}
    for encoding, headers in encodings.items():
        etags[encoding] = client.get(f"{base}/0/0/0/1/0/2", headers=headers).headers["etag"]
        assert etags[encoding].startswith('"')
        again = {**headers, "if-none-match": f'"other", {etags[encoding]}'}
        reply = client.get(f"{base}/0/0/0/1/0/2", headers=again)
        assert reply.status_code == 304
        assert reply.content == b""
        assert reply.headers["etag"] == etags[encoding]
        assert "immutable" in reply.headers["cache-control"]
    assert etags["zstd"] != etags["identity"]
    mixed = {"accept-encoding": "zstd", "if-none-match": etags["identity"]}
    assert client.get(f"{base}/0/0/0/1/0/2", headers=mixed).status_code == 200


def test_every_brick_has_an_etag_of_its_own(client: Any, base: str) -> None:
    paths = ["0/0/0/1/0/2", "0/0/0/1/0/1", "1/0/0/0/0/1", "1/0/0/1/0/0"]
    assert len({client.get(f"{base}/{path}").headers["etag"] for path in paths}) == len(paths)


def test_head_has_the_headers_of_get_and_no_body(client: Any, base: str) -> None:
    for path in ("0/0/0/1/0/2", "0/0/0/2/2/3"):
        get, head = (client.request(method, f"{base}/{path}") for method in ("GET", "HEAD"))
        assert head.status_code == get.status_code
        assert head.headers == get.headers
        assert head.content == b""


@pytest.mark.parametrize("method", ["GET", "HEAD"])
@pytest.mark.parametrize("headers", [{}, {"accept-encoding": "zstd"}, {"if-none-match": "*"}])
@pytest.mark.parametrize("path", ["0/0/0/1/0/2", "0/0/0/2/2/3", "0/0/0/9/9/9", "7/0/0/0/0/0"])
def test_the_fast_lane_and_the_documented_route_answer_alike(
    client: Any, base: str, monkeypatch: pytest.MonkeyPatch, method: str, headers: Any, path: str
) -> None:
    fast = client.request(method, f"{base}/{path}", headers=headers)
    monkeypatch.setattr("octobrick.server.bricks.brick_lane.parse_brick_path", lambda _: None)
    slow = client.request(method, f"{base}/{path}", headers=headers)
    assert (fast.status_code, fast.content) == (slow.status_code, slow.content)
    assert fast.headers == slow.headers


def test_other_revision_is_410_with_the_present_one(
    client: Any, base: str, revision: str, error_of: ErrorOf
) -> None:
    reply = client.get(base.replace(revision, "0" * 32) + "/0/0/0/0/0/0")
    assert reply.status_code == 410
    error = error_of(reply)
    assert error["kind"] == "revision-gone"
    assert error["facts"] == {"id": "head", "current_revision": revision}
    assert reply.headers["cache-control"] == "no-store"


def test_addresses_of_a_replaced_volume_are_gone_at_once(
    client: Any, base: str, error_of: ErrorOf, replace_volume: Callable[[str], None]
) -> None:
    assert client.get(f"{base}/0/0/0/1/0/2").status_code == 200
    replace_volume("head")
    error = error_of(client.get(f"{base}/0/0/0/1/0/2"))
    assert error["kind"] == "revision-gone"
    now = base.split("/bricks")[0].rsplit("/", 1)[0] + f"/{error['facts']['current_revision']}"
    assert client.get(f"{now}/bricks/0/0/0/1/0/2").status_code == 200


@pytest.mark.parametrize(
    ("path", "facts"),
    [
        ("3/0/0/0/0/0", {"index": 3, "count": 3}),
        ("0/1/0/0/0/0", {"index": 1, "count": 1}),
        ("0/0/1/0/0/0", {"index": 1, "count": 1}),
        ("0/0/0/3/0/0", {"brick_zyx": [3, 0, 0], "grid_zyx": [3, 3, 4]}),
        ("0/0/0/0/3/0", {"brick_zyx": [0, 3, 0], "grid_zyx": [3, 3, 4]}),
        ("0/0/0/0/0/4", {"brick_zyx": [0, 0, 4], "grid_zyx": [3, 3, 4]}),
        ("999999999/0/0/0/0/0", {"index": 999_999_999, "count": 3}),
    ],
)
def test_what_the_volume_lacks_is_404(
    client: Any, base: str, error_of: ErrorOf, path: str, facts: dict[str, Any]
) -> None:
    reply = client.get(f"{base}/{path}")
    assert reply.status_code == 404
    error = error_of(reply)
    assert error["kind"] == "brick-not-found"
    assert error["facts"] == facts


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("a/0/0/0/0/0", "level"),
        ("0/0/0/0/0/-1", "x"),
        ("0/0/0/1.5/0/0", "z"),
        ("0/0/0/0/1e3/0", "y"),
        ("0/0/0/0/0/1000000000", "x"),
        ("0/0/0/0/0/" + "9" * 5000, "x"),
    ],
)
def test_an_index_that_is_no_index_is_422_and_named(
    client: Any, base: str, error_of: ErrorOf, path: str, field: str
) -> None:
    reply = client.get(f"{base}/{path}")
    assert reply.status_code == 422
    error = error_of(reply)
    assert error["kind"] == "invalid-input"
    assert error["facts"]["field"] == field


def test_damaged_brick_is_an_error_of_its_own_and_the_rest_is_served(
    client: Any, base: str, data_dir: Path, head: Volume, error_of: ErrorOf
) -> None:
    stored = head.stored_brick(0, (1, 0, 2))
    assert stored is not None
    shard = data_dir / "head.zarr" / "0" / "c" / "0" / "0" / "0" / "0" / "0"
    content = bytearray(shard.read_bytes())
    content[content.index(stored) + len(stored) // 2] ^= 0xFF
    shard.write_bytes(content)
    reply = client.get(f"{base}/0/0/0/1/0/2")
    assert reply.status_code == 500
    assert error_of(reply)["kind"] == "corrupt-brick"
    assert str(data_dir) not in reply.text
    assert client.get(f"{base}/0/0/0/1/0/1").status_code == 200


@pytest.mark.parametrize(
    ("header", "accepted"),
    [
        ("zstd", True),
        ("ZSTD", True),
        ("gzip, br, zstd", True),
        ("zstd;q=0.1, gzip", True),
        ("*", True),
        ("gzip;q=1.0, *;q=0.5", True),
        ("", False),
        ("gzip, br", False),
        ("zstd;q=0", False),
        ("zstd; q=0.000, *", False),
        ("*;q=0", False),
        ("zstd;q=nonsense", False),
        ("xzstd", False),
        (",,;;,", False),
    ],
)
def test_accept_encoding_is_read_as_rfc_9110_says(header: str, accepted: bool) -> None:
    assert accepts_zstd(header) is accepted


@pytest.mark.parametrize(
    ("header", "matches"),
    [('"a"', True), ('W/"a"', True), ('"b", "a"', True), ("*", True), ('"b"', False), ("a", False)],
)
def test_if_none_match_is_read_as_rfc_9110_says(header: str, matches: bool) -> None:
    assert matches_etag(header, '"a"') is matches


def test_the_fast_lane_reads_well_formed_addresses_only() -> None:
    address = parse_brick_path("/v1/volumes/a.b-c_D/0af/bricks/1/2/3/4/5/6")
    assert address is not None
    assert (address.volume_id, address.revision) == ("a.b-c_D", "0af")
    assert (address.level, address.t, address.c, address.brick_zyx) == (1, 2, 3, (4, 5, 6))
    for path in (
        "/v1/volumes/a/0af/bricks/1/2/3/4/5",
        "/v1/volumes/a/0af/bricks/1/2/3/4/5/6/",
        "/v1/volumes/a/0af/bricks/1/2/3/4/5/6\n",
        "/v1/volumes/../0af/bricks/1/2/3/4/5/6",
        "/v1/volumes/a/0af/bricks/1/2/3/4/5/٦",
        "/v1/volumes/a/0af/bricks/1/2/3/4/5/-6",
    ):
        assert parse_brick_path(path) is None
