"""What is refused before any route, the one shape of errors, and what never leaves the server."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import hypothesis
import pytest
from hypothesis import given
from hypothesis import strategies as st

from octobrick.codec.errors import CorruptBrickError, InvalidInputError, ResourceError
from octobrick.server import Settings, create_app
from octobrick.server.errors import BusyError, answer_to, public_view
from octobrick.server.reply import accepts_zstd, matches_etag

ErrorOf = Callable[[Any], dict[str, Any]]


@pytest.mark.parametrize(
    "path",
    [
        "/v1/volumes/..%2F..%2Fetc%2Fpasswd",
        "/v1/volumes/head%2frender",
        "/v1/volumes/..%5Chead",
        "/v1/volumes/head%00.zarr",
        "/v1/volumes/%252e%252e",
        "/v1/volumes/%25",
        "/v1/volumes/head/%2F/bricks/0/0/0/0/0/0",
    ],
)
def test_encoded_separators_are_refused(client: Any, error_of: ErrorOf, path: str) -> None:
    reply = client.get(path)
    assert reply.status_code == 422
    assert error_of(reply)["kind"] == "invalid-input"


SEGMENTS = st.one_of(
    st.sampled_from(
        [
            *("v1", "volumes", "head", "torn", "bricks", "render", "0", "9", "-1", "..", ".", ""),
            *("%2e%2e", "%2F", "%00", "%ff", "~", "healthz", "docs", "*", "?", "#", ";", "9" * 99),
        ]
    ),
    st.text(alphabet="ab%./\\:?&=0\t é\u2028", max_size=12),
)


@given(segments=st.lists(SEGMENTS, max_size=12), method=st.sampled_from(["GET", "HEAD", "POST"]))
@hypothesis.settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.function_scoped_fixture],
)
def test_no_path_makes_a_fault(client: Any, segments: list[str], method: str) -> None:
    """Only the volume that is broken may answer 500, and with its own kind."""
    with contextlib.suppress(httpx.InvalidURL):  # what cannot be sent cannot harm
        reply = client.request(method, "http://test/" + "/".join(segments))
        assert reply.status_code < 500 or reply.json()["error"]["kind"] == "corrupt-volume"


@given(text=st.text(max_size=40))
def test_no_header_makes_a_fault(text: str) -> None:
    assert accepts_zstd(text) in (True, False)
    assert matches_etag(text, '"a"') in (True, False)
    assert matches_etag(f'{text}, "a"', '"a"') is True


@pytest.mark.parametrize(
    "volume_id", ["%2e%2e", ".hidden", "-", "a" * 129, "a" * 5000, "%C3%A9", "head%0a", "head%20"]
)
@pytest.mark.parametrize("rest", ["", "/0123/bricks/0/0/0/0/0/0", "/render"])
def test_an_id_that_no_volume_can_have_is_404_and_not_repeated(
    client: Any, error_of: ErrorOf, volume_id: str, rest: str
) -> None:
    reply = client.get(f"/v1/volumes/{volume_id}{rest}")
    assert reply.status_code == 404
    error = error_of(reply)
    assert error["kind"] in ("volume-not-found", "route-not-found")
    assert len(reply.content) < 400


@pytest.mark.parametrize("path", ["/", "/v1", "/v2/volumes", "/v1/volumes/", "/healthz/", "/%ff"])
def test_unknown_route_is_404(client: Any, error_of: ErrorOf, path: str) -> None:
    reply = client.get(path)
    assert reply.status_code == 404
    assert error_of(reply)["kind"] == "route-not-found"


@pytest.mark.parametrize(
    ("method", "path"),
    [("DELETE", "/v1/volumes/head"), ("POST", "/v1/volumes"), ("PUT", "/v1/volumes/head/render")],
)
def test_wrong_method_is_405_and_says_which_are_right(
    client: Any, error_of: ErrorOf, method: str, path: str
) -> None:
    reply = client.request(method, path)
    assert reply.status_code == 405
    assert "GET" in reply.headers["allow"]
    assert error_of(reply) == {
        "kind": "method-not-allowed",
        "message": f"This route does not take {method}",
        "facts": {"method": method},
    }


def test_announced_long_body_is_413(client: Any, error_of: ErrorOf) -> None:
    reply = client.post("/v1/volumes/head/render", content=b"x" * 4097)
    assert reply.status_code == 413
    error = error_of(reply)
    assert error["kind"] == "too-large"
    assert error["facts"] == {"limit_name": "max_body_nbytes", "limit": 4096, "value": 4097}


def test_endless_body_without_a_length_is_413(client: Any, error_of: ErrorOf) -> None:
    async def endless() -> Any:
        while True:
            yield b"x" * 1000

    reply = client.post("/v1/volumes/head/render", content=endless())
    assert reply.status_code == 413
    assert error_of(reply)["facts"]["value"] == 5000


def test_senseless_length_is_refused(client: Any, error_of: ErrorOf) -> None:
    reply = client.post("/healthz", headers={"content-length": "1e3"}, content=b"")
    assert reply.status_code == 422
    assert error_of(reply)["kind"] == "invalid-input"


def test_every_answer_forbids_sniffing(client: Any) -> None:
    for path in ("/healthz", "/v1/volumes/head", "/nowhere", "/docs", "/openapi.json"):
        assert client.get(path).headers["x-content-type-options"] == "nosniff"


def test_unexpected_error_is_500_with_nothing_in_it_and_a_log(
    client: Any,
    error_of: ErrorOf,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("secret: /srv/data")

    monkeypatch.setattr("octobrick.server.models.VolumeDetail.of", fail)
    with caplog.at_level(logging.ERROR):
        reply = client.get("/v1/volumes/head")
    assert reply.status_code == 500
    assert error_of(reply) == {
        "kind": "internal",
        "message": "The server met an unexpected error; its log has the details",
        "facts": {},
    }
    assert "secret" in caplog.text
    assert client.get("/v1/volumes/exact").status_code == 500
    monkeypatch.undo()
    assert client.get("/v1/volumes/head").status_code == 200


def test_message_or_fact_that_may_name_a_file_stays_here() -> None:
    error = CorruptBrickError(
        "/srv/data/head.zarr/0/c/0: brick (0, 0, 1): checksum mismatch",
        path="/srv/data/head.zarr/0/c/0",
        files=["a", "b/c"],
        level=0,
        stored="1f",
    )
    view = public_view(error)["error"]
    assert view["kind"] == "corrupt-brick"
    assert view["facts"] == {"level": 0, "stored": "1f"}
    assert "Stored data is damaged" in view["message"]


def test_message_without_a_file_goes_out_as_it_is() -> None:
    error = InvalidInputError("level 9 does not exist, there are 0 to 3", level=9)
    assert public_view(error)["error"]["message"] == error.message


@pytest.mark.parametrize(
    ("error", "status", "retries"),
    [(InvalidInputError, 422, False), (ResourceError, 503, True), (BusyError, 503, True)],
)
def test_only_what_may_pass_says_when_to_try_again(
    error: type[Any], status: int, retries: bool
) -> None:
    answer = answer_to(error)
    assert answer.status == status
    assert (answer.retry_after_seconds is not None) is retries


def test_other_origins_read_nothing_unless_a_setting_lets_them(client: Any) -> None:
    reply = client.get("/healthz", headers={"origin": "https://example.org"})
    assert "access-control-allow-origin" not in reply.headers


@pytest.fixture
def app_for_example_org(data_dir: Path) -> Any:
    return create_app(Settings(data_dir=data_dir, cors_origins=("https://example.org",)))


def test_an_origin_that_is_let_in_reads_errors_and_headers_too(
    app_for_example_org: Any, make_client: Any
) -> None:
    with make_client(app_for_example_org) as client:
        for origin, allowed in (("https://example.org", True), ("https://evil.org", False)):
            reply = client.get("/v1/volumes/tail", headers={"origin": origin})
            assert reply.status_code == 404
            assert ("access-control-allow-origin" in reply.headers) is allowed
        good = client.get("/healthz", headers={"origin": "https://example.org"})
        assert "X-Octobrick-Codec" in good.headers["access-control-expose-headers"]
