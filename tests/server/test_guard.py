"""Tokens and signed addresses over HTTP: who sees what, and what nobody learns."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pydantic import SecretStr

from octobrick.codec.errors import InvalidInputError
from octobrick.server import Settings, create_app
from octobrick.server.security.guard import guard_of
from octobrick.server.security.signed_paths import signed_prefix
from octobrick.server.security.tokens import token_entry

ErrorOf = Callable[[Any], dict[str, Any]]
KEY = "k" * 32
PAST, FUTURE = 1_000, 4_102_444_800  # 2100: the same in every process that collects tests


def bearer(secret: str) -> dict[str, str]:
    return {"authorization": f"Bearer {secret}"}


@pytest.fixture
def tokens_file(tmp_path: Path) -> Path:
    path = tmp_path / "tokens.json"
    entries = [
        token_entry("ann", "ann-secret", ("head*",), None),
        token_entry("bob", "bob-secret", ("*",), None),
        token_entry("eve", "eve-secret", ("head",), None),
        token_entry("old", "old-secret", ("*",), datetime.fromtimestamp(PAST, UTC)),
    ]
    path.write_text(json.dumps(entries))
    return path


@pytest.fixture
def guarded(data_dir: Path, tokens_file: Path, make_client: Any) -> Iterator[Any]:
    settings = Settings(
        data_dir=data_dir,
        tokens_file=tokens_file,
        signing_key=SecretStr(KEY),
        cors_origins=("https://example.org",),
    )
    with make_client(create_app(settings)) as client:
        yield client


@pytest.fixture
def brick(guarded: Any) -> str:
    address: str = guarded.get("/v1/volumes/head", headers=bearer("bob-secret")).json()["bricks"]
    return address.format(level=0, t=0, c=0, z=0, y=0, x=0)


@pytest.mark.parametrize(
    "path",
    ["/v1/volumes", "/v1/volumes/head", "/v1/volumes/tail", "/v1/new", "/zarr/head/zarr.json",
     "/precomputed/head/info", "/nowhere", "/v1/volumes/head/0a/bricks/0/0/0/0/0/0"],
)  # fmt: skip
@pytest.mark.parametrize(
    "headers",
    [{}, bearer("wrong"), bearer(""), bearer("old-secret"), {"authorization": "Basic YTpi"}],
)
def test_without_a_good_token_everything_is_401_whether_it_exists_or_not(
    guarded: Any, error_of: ErrorOf, path: str, headers: dict[str, str]
) -> None:
    reply = guarded.get(path, headers=headers)
    assert reply.status_code == 401
    assert reply.headers["www-authenticate"] == 'Bearer realm="octobrick"'
    assert reply.headers["cache-control"] == "no-store"
    assert error_of(reply)["kind"] == "unauthorized"
    assert error_of(reply)["facts"] == {}


def test_a_volume_that_a_token_does_not_cover_is_as_one_that_does_not_exist(
    guarded: Any, error_of: ErrorOf
) -> None:
    replies = [
        guarded.get(f"/v1/volumes/{volume_id}{rest}", headers=bearer("ann-secret"))
        for volume_id in ("exact", "torn", "never-was")
        for rest in ("", "/render", "/0a/bricks/0/0/0/0/0/0")
    ]
    assert {reply.status_code for reply in replies} == {403}
    assert len({reply.content for reply in replies}) == 1
    assert error_of(replies[0])["kind"] == "forbidden"


def test_the_list_shows_what_the_caller_may_see(guarded: Any) -> None:
    def seen(secret: str) -> list[str]:
        reply = guarded.get("/v1/volumes", headers=bearer(secret))
        assert "public" not in reply.headers["cache-control"]
        return [volume["id"] for volume in reply.json()["volumes"]]

    assert seen("ann-secret") == ["head"]
    assert seen("bob-secret") == ["exact", "head", "plain", "torn"]


def test_answers_to_tokens_are_not_for_shared_caches(guarded: Any, brick: str) -> None:
    reply = guarded.get(brick, headers=bearer("ann-secret"))
    assert reply.status_code == 200
    assert reply.headers["cache-control"] == "private, max-age=31536000, immutable"
    etag = reply.headers["etag"]
    again = guarded.get(brick, headers=bearer("ann-secret") | {"if-none-match": etag})
    assert again.status_code == 304
    assert "public" not in again.headers["cache-control"]


def test_a_signed_address_gives_its_volume_until_it_expires(guarded: Any, brick: str) -> None:
    prefix = signed_prefix(KEY.encode(), "head", int(time.time()) + 3_600)
    detail = guarded.get(f"{prefix}/v1/volumes/head").json()
    assert detail["bricks"].startswith(f"{prefix}/v1/volumes/head/"), "it leads on"
    reply = guarded.get(prefix + brick)
    assert reply.status_code == 200
    assert reply.content == guarded.get(brick, headers=bearer("bob-secret")).content
    policy = reply.headers["cache-control"].split(", ")
    assert policy[0] == "public"
    assert 0 < int(policy[1].removeprefix("max-age=")) <= 3_600, "no cache outlives the address"


@pytest.mark.parametrize("route", ["zarr/{}/zarr.json", "zarr2/{}/.zgroup", "precomputed/{}/info"])
def test_leave_for_a_volume_is_leave_for_its_pinned_addresses_in_other_formats(
    guarded: Any, route: str
) -> None:
    eve = bearer("eve-secret")
    revision = guarded.get("/v1/volumes/head", headers=eve).json()["revision"]
    prefix = signed_prefix(KEY.encode(), "head", FUTURE)
    for name in ("head", f"head@{revision}", f"head%40{revision}"):
        address = "/" + route.format(name)
        assert guarded.get(address, headers=eve).status_code == 200, address
        assert guarded.get(prefix + address).status_code == 200, address
        other = address.replace("head", "exact")
        assert guarded.get(other, headers=eve).status_code == 403, other
        assert guarded.get(prefix + other).status_code == 403, other


@pytest.mark.parametrize(
    ("volume_id", "expires", "path"),
    [
        ("head", PAST, "/v1/volumes/head"),
        ("exact", FUTURE, "/v1/volumes/head"),
        ("head", FUTURE, "/v1/volumes"),
        ("head", FUTURE, "/v1/volumes/"),
        ("head", FUTURE, "/v1/volumes/head2"),
        ("head", FUTURE, "/zarr/head2@head/zarr.json"),
        ("head", FUTURE, "/zarr/@head/zarr.json"),
        ("head", FUTURE, "/metrics"),
        ("head", FUTURE, "/signed/1/x/v1/volumes/head"),
    ],
)
def test_a_signed_address_is_good_for_nothing_else(
    guarded: Any, error_of: ErrorOf, volume_id: str, expires: int, path: str
) -> None:
    reply = guarded.get(
        signed_prefix(KEY.encode(), volume_id, expires) + path, headers=bearer("bob-secret")
    )
    assert reply.status_code == 403
    assert error_of(reply)["kind"] == "forbidden"


def test_probes_and_descriptions_are_open(guarded: Any) -> None:
    for path in ("/healthz", "/readyz", "/docs", "/openapi.json"):
        assert guarded.get(path).status_code == 200


def test_a_preflight_passes_without_a_token_and_pages_can_read_refusals(guarded: Any) -> None:
    origin = {"origin": "https://example.org"}
    asked = {"access-control-request-method": "GET"}
    asked["access-control-request-headers"] = "authorization,if-none-match"
    reply = guarded.request("OPTIONS", "/v1/volumes/head", headers=origin | asked)
    assert reply.status_code == 200
    assert "Authorization" in reply.headers["access-control-allow-headers"]
    refused = guarded.get("/v1/volumes/head", headers=origin)
    assert refused.status_code == 401
    assert refused.headers["access-control-allow-origin"] == "https://example.org"


def test_an_open_server_has_no_guard_and_no_signed_addresses(client: Any, data_dir: Path) -> None:
    assert guard_of(Settings(data_dir=data_dir)) is None
    prefix = signed_prefix(KEY.encode(), "head", FUTURE)
    assert client.get(f"{prefix}/v1/volumes/head").status_code == 404


def test_a_key_that_others_may_read_stops_the_start(data_dir: Path, tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_text(KEY)
    path.chmod(0o644)
    with pytest.raises(InvalidInputError, match="chmod 0640"):
        guard_of(Settings(data_dir=data_dir, signing_key_file=path))
    path.chmod(0o640)
    assert guard_of(Settings(data_dir=data_dir, signing_key_file=path)) is not None


def test_secrets_of_settings_are_not_shown(data_dir: Path) -> None:
    settings = Settings(data_dir=data_dir, signing_key=SecretStr(KEY), metrics_token=SecretStr(KEY))
    assert KEY not in repr(settings)
