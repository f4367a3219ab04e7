"""A volume on a server reads as the same one on disk, whatever the network does."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import CorruptBrickError, InvalidInputError, OctobrickError
from octobrick.store import Box, LocalVolume, Volume, ingest, open_volume
from octobrick.store.brick_cache import BrickCache
from octobrick.store.errors import (
    BrickStreamError,
    RevisionGoneError,
    ServerUnreachableError,
    VolumeFormatError,
    VolumeNotFoundError,
)
from octobrick.store.http_address import volume_address
from octobrick.store.http_link import LinkOptions
from octobrick.store.http_volume import HttpVolume
from octobrick.store.retry import Retries, RetryPolicy

from .conftest import smooth
from .stand_in_server import Handler, StandInServer

QUICK = LinkOptions(2.0, 2.0, 5.0, RetryPolicy(0.001, 0.002, 0.5))


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalVolume]:
    folder = tmp_path_factory.mktemp("volume")
    voxels = smooth((37, 50, 41))
    voxels[:, :, 16:32] = 0  # absent bricks
    np.save(folder / "head.npy", voxels)
    ingest(folder / "head.npy", folder / "head.zarr", brick=16, shard=2, gradients=True)
    with open_volume(folder / "head.zarr") as volume:
        yield volume


@pytest.fixture
def server(local: LocalVolume) -> Iterator[StandInServer]:
    server = StandInServer(local)
    yield server
    server.close()


@pytest.fixture
def cache(tmp_path: Path) -> BrickCache:
    return BrickCache(tmp_path / "cache")


@pytest.fixture
def remote(server: StandInServer, cache: BrickCache) -> Iterator[HttpVolume]:
    with HttpVolume(server.url, token="", cache=cache, options=QUICK) as volume:
        yield volume


def places(volume: Volume, level: int = 0) -> list[tuple[int, tuple[int, int, int], int, int]]:
    return [(level, (z, y, x), 0, 0) for z, y, x in np.ndindex(*volume.level(level).grid_zyx)]


def once(answer: Callable[[Handler], None], part: str = "/bricks/") -> Callable[[Handler], bool]:
    """A fault of the first request whose path has this part."""
    left = [True]

    def fault(handler: Handler) -> bool:
        if not left or part not in handler.path:
            return False
        left.clear()
        answer(handler)
        return True

    return fault


def always(answer: Callable[[Handler], None], part: str = "/bricks/") -> Callable[[Handler], bool]:
    def fault(handler: Handler) -> bool:
        if part in handler.path:
            answer(handler)
        return part in handler.path

    return fault


# What both volumes promise


@pytest.mark.parametrize("twice", [False, True], ids=["cold", "from the cache"])
def test_all_that_is_read_equals_the_local_volume(
    local: LocalVolume, remote: HttpVolume, server: StandInServer, twice: bool
) -> None:
    for _ in range(1 + twice):
        for level in range(len(local.levels)):
            np.testing.assert_array_equal(remote.read(level), local.read(level), strict=True)
            np.testing.assert_array_equal(remote.ranges(level), local.ranges(level), strict=True)
            np.testing.assert_array_equal(
                remote.fidelity(level), local.fidelity(level), strict=True
            )
            for place in places(local, level):
                assert remote.stored_brick(*place) == local.stored_brick(*place)
                assert remote.brick_code(*place) == local.brick_code(*place)
        assert local.gradients is not None
        assert remote.gradients is not None
        assert remote.gradients.levels == local.gradients.levels
        for level in local.gradients.levels:
            np.testing.assert_array_equal(remote.gradients.read(level), local.gradients.read(level))
    assert server.requests("/bricks/") == 0  # what is read is in the cache then


def test_all_that_is_said_of_it_equals_the_local_volume(
    local: LocalVolume, remote: HttpVolume
) -> None:
    assert remote.metadata() == local.metadata()
    assert remote.attributes() == local.attributes()
    assert remote.levels == local.levels
    assert repr(remote) == repr(local)
    assert [h.counts.tolist() for h in remote.histograms] == [
        h.counts.tolist() for h in local.histograms
    ]
    box = Box((3, 5, 7), (30, 20, 40))
    np.testing.assert_array_equal(remote.read(0, box), local.read(0, box))


def test_a_brick_outside_is_refused_without_asking(
    remote: HttpVolume, server: StandInServer
) -> None:
    for read in (remote.stored_brick, remote.brick_code, remote.brick):
        with pytest.raises(InvalidInputError, match="has no brick"):
            read(0, (9, 0, 0))
    assert server.requests("/bricks/") == 0


def test_a_batch_gives_all_bricks_in_order_and_then_from_the_cache(
    local: LocalVolume, remote: HttpVolume, server: StandInServer
) -> None:
    asked = places(local)[::-1]
    for _ in range(2):
        came = list(remote.brick_codes(asked))
        assert [number for number, _ in came] == list(range(len(asked)))
        assert [code for _, code in came] == [local.brick_code(*place) for place in asked]
    assert server.requests("POST") == 1
    assert server.requests("/bricks/") == 0
    assert remote.gradients is not None
    assert local.gradients is not None
    codes = [code for _, code in remote.gradients.brick_codes(places(local, 1))]
    assert codes == [local.gradients.code(*place) for place in places(local, 1)]


def test_a_box_is_read_in_few_requests_and_not_more_than_it_touches(
    local: LocalVolume, server: StandInServer, tmp_path: Path
) -> None:
    none = BrickCache(tmp_path, nbytes_max=0)
    with HttpVolume(server.url, token="", cache=none, options=QUICK) as remote:
        remote._bricks.batch_max = 10
        box = Box((3, 5, 7), (30, 50, 40))
        np.testing.assert_array_equal(remote.read(0, box), local.read(0, box), strict=True)
        assert [len(batch) for batch in server.batches] == [10, 10, 4]
        server.batches.clear()
        assert remote.gradients is not None
        assert local.gradients is not None
        np.testing.assert_array_equal(remote.gradients.read(1), local.gradients.read(1))
    assert [len(batch) for batch in server.batches] == [len(places(local, 1))]
    assert server.requests("/bricks/") == server.requests("/gradients/") == 0


# What goes wrong and mends itself


@pytest.mark.parametrize("status", [429, 502, 503, 504])
def test_a_busy_server_is_asked_again(
    remote: HttpVolume, local: LocalVolume, server: StandInServer, status: int
) -> None:
    server.faults.append(once(lambda h: h.error(status, "busy", "later", Retry_After="0")))
    assert remote.stored_brick(0, (0, 0, 0)) == local.stored_brick(0, (0, 0, 0))
    assert server.requests("/bricks/") == 2


@pytest.mark.parametrize(
    "answer",
    [
        Handler.cut,
        lambda h: (h.send_response(200), h.send_header("Content-Length", "99999"),
                   h.send_header("Content-Encoding", "zstd"), h.end_headers(), h.cut()),
        lambda h: h.answer(200, b"\x28\xb5\x2f\xfdnonsense", Content_Encoding="zstd"),
    ],
    ids=["cut before the answer", "cut inside the body", "wrong bytes"],
)  # fmt: skip
def test_a_brick_that_comes_badly_once_is_fetched_again(
    remote: HttpVolume,
    local: LocalVolume,
    server: StandInServer,
    answer: Callable[[Handler], None],
) -> None:
    server.faults.append(once(answer))
    assert remote.stored_brick(0, (0, 0, 0)) == local.stored_brick(0, (0, 0, 0))
    assert server.requests("/bricks/") == 2


def test_a_stream_that_is_cut_goes_on_with_the_bricks_that_are_missing(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    def cut_third(handler: Handler, index: int) -> None:
        if index == 3 and len(server.batches) <= 3:
            handler.cut()

    server.stream_fault = cut_third
    asked = places(local)
    assert [code for _, code in remote.brick_codes(asked)] == [
        local.brick_code(*place) for place in asked
    ]
    assert [len(batch) for batch in server.batches] == [36, 33, 30, 27]


def test_a_lower_limit_of_the_server_makes_smaller_batches(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    import json

    def limit(handler: Handler) -> bool:
        if handler.command == "GET" or len(json.loads(handler.body)["bricks"]) <= 10:
            return False
        handler.error(413, "too-large", "at most 10")
        return True

    server.faults.append(limit)
    assert len(list(remote.brick_codes(places(local)))) == 36
    assert [len(batch) for batch in server.batches] == [9, 9, 9, 9]


# What does not mend itself


def test_wrong_bytes_twice_are_an_error_that_names_the_address_and_are_not_kept(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    server.damage = lambda stored: stored[:-1] + bytes([stored[-1] ^ 1])
    with pytest.raises(CorruptBrickError, match=r"127\.0\.0\.1.*/bricks/0/0/0/0/0/0.*checksum"):
        remote.brick(0, (0, 0, 0))
    assert server.requests("/bricks/") == 2
    outcomes = [outcome for _, outcome in remote.brick_codes(places(local)[:1])]
    assert isinstance(outcomes[0], CorruptBrickError)
    with pytest.raises(CorruptBrickError, match=r"127\.0\.0\.1.*/bricks/0/0/0/0/0/0.*checksum"):
        remote.read(0)
    server.damage = lambda stored: stored
    assert remote.stored_brick(0, (0, 0, 0)) == local.stored_brick(0, (0, 0, 0))


@pytest.mark.parametrize("status", [400, 404, 422, 500, 501])
def test_an_error_of_the_server_is_ours_and_is_not_asked_for_again(
    remote: HttpVolume, server: StandInServer, status: int
) -> None:
    server.faults.append(always(lambda h: h.error(status, "odd-kind", "what\nit says" * 200)))
    with pytest.raises(OctobrickError, match="what it says") as caught:
        remote.stored_brick(0, (0, 0, 0))
    assert caught.value.kind == "odd-kind"
    assert len(caught.value.message) < 1000
    assert server.requests("/bricks/") == 1


def test_a_replaced_volume_says_to_open_it_anew(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    server.faults.append(always(lambda h: h.error(410, "revision-gone", "gone"), "bricks"))
    with pytest.raises(RevisionGoneError, match="open it anew"):
        remote.brick(0, (0, 0, 0))
    with pytest.raises(RevisionGoneError, match="open it anew"):
        list(remote.brick_codes(places(local)))


def test_a_redirect_is_not_followed_and_takes_no_token_along(
    server: StandInServer, cache: BrickCache
) -> None:
    server.faults.append(always(lambda h: h.answer(302, Location=h.path), "/v1"))
    with pytest.raises(ServerUnreachableError, match="sends elsewhere"):
        HttpVolume(server.url, token="secret", cache=cache, options=QUICK)
    assert len(server.log) == 1


@pytest.mark.parametrize(
    "body", [b"", b"[]", b"{}", b'{"revision": 5}', b'{"revision": "../../x"}', b"[" * 100_000,
             b'{"revision": "' + b"0" * 2**21],
)  # fmt: skip
def test_nonsense_instead_of_metadata_is_an_error(
    server: StandInServer, cache: BrickCache, body: bytes
) -> None:
    server.faults.append(always(lambda h: h.answer(200, body), "head"))
    with pytest.raises((ServerUnreachableError, VolumeFormatError)):
        HttpVolume(server.url, token="", cache=cache, options=QUICK)


def test_an_endless_body_is_refused_in_bounded_memory(
    remote: HttpVolume, server: StandInServer
) -> None:
    def endless(handler: Handler) -> None:
        handler.send_response(200)
        handler.send_header("Transfer-Encoding", "chunked")
        handler.end_headers()
        while True:
            handler.chunk(bytes(65536))

    server.faults.append(always(endless))
    with pytest.raises(ServerUnreachableError, match="longer than"):
        remote.stored_brick(0, (0, 0, 0))


@pytest.mark.parametrize("body", [b"nonsense", b"OBKS\1\0\0\0\5\0\0\0\0\0\0\0", b""])
def test_a_stream_of_nonsense_is_an_error_in_the_end(
    remote: HttpVolume, local: LocalVolume, server: StandInServer, body: bytes
) -> None:
    server.faults.append(always(lambda h: h.answer(200, body), "head/bricks"))
    with pytest.raises(BrickStreamError):
        list(remote.brick_codes(places(local)))


def test_a_server_that_is_down_is_an_error_after_the_deadline(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    server.faults.append(lambda h: h.cut() or True)
    with pytest.raises(ServerUnreachableError, match="breaks off"):
        remote.stored_brick(0, (0, 0, 0))
    with pytest.raises(ServerUnreachableError, match="breaks off"):
        list(remote.brick_codes(places(local)))


def test_an_unknown_volume_is_not_found(server: StandInServer, cache: BrickCache) -> None:
    server.faults.append(always(lambda h: h.error(404, "volume-not-found", "none"), "head"))
    with pytest.raises(VolumeNotFoundError):
        HttpVolume(server.url, token="", cache=cache, options=QUICK)


# Cancelling and closing


def test_a_closed_batch_wakes_who_waits_and_asks_no_more(
    remote: HttpVolume, local: LocalVolume, server: StandInServer
) -> None:
    held, release = threading.Event(), threading.Event()

    def hold(handler: Handler, index: int) -> None:
        if index == 2:
            held.set()
            release.wait(30)

    server.stream_fault = hold
    batch = remote.brick_codes(places(local))
    came: list[int] = []
    two = threading.Event()

    def take() -> None:
        for number, _ in batch:
            came.append(number)
            if number == 1:
                two.set()

    reader = threading.Thread(target=take)
    reader.start()
    assert held.wait(30)
    assert two.wait(30)
    batch.close()
    reader.join(30)
    release.set()
    assert not reader.is_alive()
    assert came == [0, 1]
    assert server.requests("POST") == 1


def test_a_closed_volume_says_so(remote: HttpVolume) -> None:
    remote.close()
    with pytest.raises(InvalidInputError, match="closed"):
        remote.stored_brick(0, (0, 0, 0))


# Addresses, tokens, patience


def test_the_token_goes_to_the_server_and_a_bad_one_is_refused(
    server: StandInServer, cache: BrickCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OCTOBRICK_TOKEN", "from-the-environment")
    HttpVolume(server.url, cache=cache).close()
    HttpVolume(server.url, cache=cache, token="argument").close()
    sent = [headers.get("Authorization") for headers in server.headers]
    assert sent == ["Bearer from-the-environment"] * 2 + ["Bearer argument"]
    with pytest.raises(InvalidInputError, match="token"):
        HttpVolume(server.url, cache=cache, token="a\r\nHost: b")


@pytest.mark.parametrize(
    "text",
    ["http://host/", "http://host/v1/volumes/", "ftp://host/v1/volumes/a", "http:///v1/volumes/a",
     "http://host/v1/volumes/a?x=1", "http://u:p@host/v1/volumes/a", "http://host:99999/v1/volumes/a",
     "http://host/v1/volumes/../a", "http://host/v1/volumes/a/b", "http://ho st/v1/volumes/ä"],
)  # fmt: skip
def test_what_is_no_address_of_a_volume_is_refused_by_name(text: str) -> None:
    with pytest.raises(InvalidInputError):
        volume_address(text)


def test_a_signed_address_is_used_whole_and_shown_without_its_signature() -> None:
    address = volume_address("https://host/signed/99/abc_-/v1/volumes/head")
    assert address.volume_path == "/signed/99/abc_-/v1/volumes/head"
    assert str(address) == "https://host/signed/…/v1/volumes/head"


def test_pauses_grow_are_capped_and_end_at_the_deadline() -> None:
    pauses: list[float] = []
    retries = Retries(RetryPolicy(1, 5, 60), pauses.append, clock=lambda: sum(pauses))
    error = ServerUnreachableError("down")
    for _ in range(5):
        retries.wait_after(error)
    bounds = [(0.5, 1), (1, 2), (2, 4), (2.5, 5), (2.5, 5)]
    assert all(low <= p <= high for p, (low, high) in zip(pauses, bounds, strict=True))
    retries.wait_after(error, asked_seconds=1e9)
    assert pauses[-1] == 30
    with pytest.raises(ServerUnreachableError):
        drain(retries, error)
    assert sum(pauses) <= 60


def drain(retries: Retries, error: OctobrickError) -> None:
    for _ in range(100):
        retries.wait_after(error)
