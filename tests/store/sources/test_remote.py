"""Zarr on servers: the same voxels as in files, and what is said where a server fails."""

from __future__ import annotations

import base64
import os
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import zarr
from zarr.codecs import BloscCodec, ZstdCodec

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import (
    SourceError,
    SourceMismatchError,
    SourceNotFoundError,
    SourceUnreachableError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources import open_source

from .conftest import make_voxels
from .web import Web, broken_off, dead_after, fixed, silent, status
from .writers_arrays import multiscales

SHAPE = (12, 20, 30)
SPACING = (2.5, 0.75, 0.5)


@pytest.fixture(autouse=True)
def surroundings(monkeypatch):
    """No credentials, no proxies, and retries that do not take long."""
    for name in list(os.environ):
        if name.startswith("AWS_") or name.lower().endswith("_proxy"):
            monkeypatch.delenv(name)
    remote = "octobrick.store.sources.remote"
    monkeypatch.setattr(f"{remote}._BACKOFF_SECONDS", 0.001)
    monkeypatch.setattr(f"{remote}._RETRIES", 3)
    monkeypatch.setattr(f"{remote}_store._PAUSE_SECONDS", 0.001)


@pytest.fixture
def voxels():
    return make_voxels("uint16", SHAPE)


@pytest.fixture
def web(tmp_path):
    """A server over the bucket ``b``, of which tests make ``a.zarr``."""
    (tmp_path / "b").mkdir()
    with Web(tmp_path).running() as web:
        yield web


@pytest.fixture
def folder(tmp_path, web):
    return tmp_path / "b" / "a.zarr"


def image(folder: Path, voxels: np.ndarray, version: int = 3, **options: object) -> None:
    group = zarr.create_group(folder, zarr_format=version, overwrite=True)
    options = {"chunks": (4, 8, 8), "zarr_format": version} | options
    del options["zarr_format"]
    array = group.create_array("0", shape=voxels.shape, dtype=voxels.dtype, **options)
    array[:] = voxels
    described = multiscales("zyx", ["0"], SPACING, "0.4" if version == 2 else None)
    ome = {"multiscales": described}
    group.attrs.update(ome if version == 2 else {"ome": ome | {"version": "0.5"}})


KINDS = {
    "0.4": {"version": 2},
    "0.5": {},
    "0.5-zstd": {"compressors": ZstdCodec()},
    "0.5-blosc": {"compressors": BloscCodec()},
    "0.5-shards": {"shards": (8, 16, 16)},
    "0.5-shards-of-blosc": {"shards": (8, 16, 16), "compressors": BloscCodec()},
}


def read_all(source):
    return source.read(Box.of_shape(source.shape_zyx))


@pytest.fixture(params=["http", "s3"])
def address(request, web, monkeypatch):
    """Where ``a.zarr`` is, by both ways."""
    if request.param == "http":
        return f"{web.url}/b/a.zarr"
    monkeypatch.setenv("AWS_ENDPOINT_URL", web.url)
    return "s3://b/a.zarr"


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_server_has_is_read_as_from_files(folder, address, voxels, kind):
    image(folder, voxels, **KINDS[kind])
    with open_source(folder) as local, open_source(address) as source:
        assert source.describe() == local.describe()
        assert source.files == ()
        np.testing.assert_array_equal(read_all(source), voxels)
        box = Box((3, 5, 2), (6, 19, 30))
        np.testing.assert_array_equal(source.read(box), voxels[box.slices])


def test_an_address_is_shown_as_it_was_given_and_names_the_source(folder, address, voxels):
    image(folder, voxels)
    with open_source(address, spacing_zyx=(1, 2, 3)) as source:
        assert str(source.path) == address
        assert source.path.name == "a.zarr"
        assert source.spacing_zyx == (1, 2, 3)
        with pytest.raises(InvalidInputError, match=f"reading {address}"):
            source.read(Box((0, 0, 0), (99, 1, 1)))
    with open_source(address + "/") as source:
        assert source.describe()["file"] == "a.zarr"


def test_password_and_query_are_sent_and_never_shown(folder, web, voxels):
    image(folder, voxels)
    address = web.url.replace("//", "//me:se%40cret@") + "/b/a.zarr?token=secret"
    with open_source(address) as source:
        read_all(source)
        assert str(source.path) == f"{web.url}/b/a.zarr"
        assert "cret" not in str(source.fingerprint())
    token = "Basic " + base64.b64encode(b"me:se@cret").decode()
    assert {headers["authorization"] for _, _, headers in web.asked} == {token}
    with pytest.raises(SourceNotFoundError) as caught:
        open_source(address.replace("a.zarr", "c.zarr"))
    web.trick = status(500)
    with pytest.raises(SourceUnreachableError) as unreachable:
        open_source(address)
    for error in (caught.value, unreachable.value):
        assert "cret" not in str(error) + str(error.facts)


def test_a_part_is_named_by_dataset_and_its_axes(folder, web, voxels):
    zarr.create_group(folder).create_array("deep/x", data=np.ascontiguousarray(voxels.T))
    with open_source(f"{web.url}/b/a.zarr", dataset="deep/x", axes="xyz") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    with pytest.raises(InvalidInputError, match=r"no Zarr array or group at 'deep/y'"):
        open_source(f"{web.url}/b/a.zarr", dataset="deep/y")


@pytest.mark.filterwarnings("ignore:Consolidated metadata")
def test_what_is_in_a_group_is_known_where_metadata_are_consolidated(folder, address, voxels):
    zarr.create_group(folder).create_array("deep", data=voxels)
    with pytest.raises(InvalidInputError, match=r"cannot be listed.*--dataset PATH"):
        open_source(address)
    zarr.consolidate_metadata(folder)
    with open_source(address) as source:
        np.testing.assert_array_equal(read_all(source), voxels)


def test_options_of_raw_files_are_refused(web):
    with pytest.raises(InvalidInputError, match="leave out --shape"):
        open_source(f"{web.url}/b/a.zarr", shape_zyx=(1, 2, 3))


@pytest.mark.parametrize(
    ("address", "error", "text"),
    [
        ("gs://bucket/a.zarr", UnsupportedSourceError, "begin with http://, https://, s3://"),
        ("file:///tmp/a.zarr", UnsupportedSourceError, "files are named by their path"),
        ("http:///a.zarr", InvalidInputError, "no server is named"),
        ("https://[half/a.zarr", InvalidInputError, "is no address"),
        ("https://host:port/a.zarr", InvalidInputError, "is no address"),
        ("https://host/a\n.zarr", InvalidInputError, "no server"),
    ],
)
def test_what_is_no_address_is_refused(address, error, text):
    with pytest.raises(error, match=text):
        open_source(address)


def test_without_the_package_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "obstore", None)
    with pytest.raises(ResourceError, match=r"obstore.*octobrick\[remote\]"):
        open_source("https://host/a.zarr")


# Servers that fail


def test_a_missing_source_says_so_and_that_only_zarr_is_read(address):
    with pytest.raises(SourceNotFoundError, match=f"{address}: no Zarr.*other formats are not"):
        open_source(address)


def test_a_server_that_is_not_there_is_named_with_the_reason(web):
    address = "http://127.0.0.1:1/a.zarr"
    with pytest.raises(SourceUnreachableError, match=r"127.0.0.1:1 \(Connection refused\).*3 tim"):
        open_source(address)
    with pytest.raises(SourceUnreachableError, match=r"no connection to no\.such\.invalid"):
        open_source("http://no.such.invalid/a.zarr")
    with pytest.raises(SourceUnreachableError, match=r"no connection.*TLS: InvalidMessage"):
        open_source(web.url.replace("http", "https") + "/a.zarr")


@pytest.mark.parametrize(
    ("trick", "text"),
    [
        (status(403), r"refuses it \(403 Forbidden\); it may be for others"),
        (status(401), r"refuses it \(401 Unauthorized\)"),
        (status(500), r"answers 500 Internal Server Error, 3 times"),
        (status(429), r"answers 429 Too Many Requests, 3 times"),
        (status(418), r"answers 418 "),
        (broken_off(""), "breaks off before its end"),
        (dead_after(0), r"3 times"),
        (fixed(302, b"", {"Location": "/login"}), "in circles"),
        (fixed(200, b"<html>", {"Content-Type": "text/html; charset=utf-8"}), "web page"),
    ],
    ids=["403", "401", "500", "429", "418", "broken-off", "dead", "circles", "web-page"],
)
def test_a_server_that_refuses_or_fails_is_unreachable_with_its_reason(web, trick, text):
    web.trick = trick
    with pytest.raises(SourceUnreachableError, match=f"{web.url}/b/a.zarr: .*{text}"):
        open_source(f"{web.url}/b/a.zarr")


def test_a_silent_server_is_given_up_in_time(web, folder, voxels, monkeypatch):
    monkeypatch.setattr("octobrick.store.sources.remote._SILENCE_SECONDS", 0.1)
    image(folder, voxels)
    web.trick = silent("0/c/0/0/0", 0.3)
    started = time.monotonic()
    with (
        open_source(f"{web.url}/b/a.zarr") as source,
        pytest.raises(SourceUnreachableError, match=r"0/c/0/0/0 .*does not answer in time, 4 time"),
    ):
        read_all(source)
    assert time.monotonic() - started < 5


def test_a_read_of_a_silent_server_can_be_abandoned(web, folder, voxels):
    image(folder, voxels)
    web.trick = silent("0/c/0/0/0", 0.5)
    with open_source(f"{web.url}/b/a.zarr") as source, ThreadPoolExecutor(1) as executor:
        read = executor.submit(read_all, source)
        while not any("/c/0/0/0" in path for path in web.paths()):
            time.sleep(0.01)
        source.abandon()
        with pytest.raises(SourceError, match="cannot be read"):
            read.result(timeout=0.4)
        web.trick = lambda handler: False
        np.testing.assert_array_equal(read_all(source), voxels)


@pytest.mark.parametrize("trick", [status, broken_off])
def test_a_failure_that_passes_is_not_seen(web, folder, voxels, trick):
    image(folder, voxels)
    web.trick = trick(503, "0/c/1/1/1", times=2) if trick is status else trick("0/c/1/1/1", times=2)
    with open_source(f"{web.url}/b/a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    assert web.paths().count("/b/a.zarr/0/c/1/1/1") == 3


def test_without_ranges_shards_are_refused_and_chunks_read(web, folder, voxels):
    web.ranges = False
    image(folder, voxels)
    with open_source(f"{web.url}/b/a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    image(folder, voxels, shards=(8, 16, 16))
    with (
        open_source(f"{web.url}/b/a.zarr") as source,
        pytest.raises(UnsupportedSourceError, match=r"no HTTP Range.*nginx"),
    ):
        source.read(Box((0, 0, 0), (1, 1, 1)))


def test_an_answer_of_unknown_length_is_refused(web, folder, voxels):
    image(folder, voxels)

    def unmeasured(handler):
        handler.send_response(200)
        handler.end_headers()
        handler.close_connection = True
        return True

    web.trick = unmeasured
    with pytest.raises(UnsupportedSourceError, match="no Content-Length"):
        open_source(f"{web.url}/b/a.zarr")


def test_metadata_of_any_size_are_not_read(web, monkeypatch):
    monkeypatch.setattr("octobrick.store.sources.remote_store._METADATA_LIMIT_NBYTES", 10)
    web.trick = fixed(200, b"{" * 11, {}, end="zarr.json")
    with pytest.raises(SourceError, match=r"zarr.json has 11 bytes, 10 are the most"):
        open_source(f"{web.url}/b/a.zarr")


def test_metadata_that_are_none_are_refused(web):
    web.trick = fixed(200, b"hello", {}, end="zarr.json")
    with pytest.raises(SourceError, match="the Zarr header cannot be read"):
        open_source(f"{web.url}/b/a.zarr")


@pytest.mark.parametrize("keep", [0, -1])
def test_chunks_that_were_cut_short_are_truncated(web, folder, voxels, keep):
    image(folder, voxels, compressors=BloscCodec())
    chunk = folder / "0" / "c" / "1" / "1" / "1"
    chunk.write_bytes(chunk.read_bytes()[:keep])
    with (
        open_source(f"{web.url}/b/a.zarr") as source,
        pytest.raises(TruncatedSourceError, match="0/c/1/1/1"),
    ):
        read_all(source)


def test_a_shard_that_was_cut_short_is_an_error(web, folder, voxels):
    image(folder, voxels, shards=(8, 16, 16))
    with open_source(f"{web.url}/b/a.zarr") as source:
        source.read(Box((0, 0, 0), (1, 1, 1)))  # its index is known now
        shard = folder / "0" / "c" / "0" / "0" / "0"
        shard.write_bytes(shard.read_bytes()[:700])
        with pytest.raises(TruncatedSourceError, match="ends before the bytes"):
            source.read(Box((0, 0, 0), (8, 16, 8)))


def test_a_source_that_is_gone_is_not_taken_for_an_empty_one(web, folder, voxels):
    image(folder, voxels)
    shutil.rmtree(folder / "0" / "c")
    with open_source(f"{web.url}/b/a.zarr") as source:
        assert (read_all(source) == 0).all()
        shutil.rmtree(folder / "0")
        with pytest.raises(SourceUnreachableError, match=r"0/zarr.json is not there any more"):
            read_all(source)


def test_a_shard_that_vanishes_is_not_taken_for_an_empty_one(web, folder, voxels):
    image(folder, voxels, shards=(8, 16, 16))
    with open_source(f"{web.url}/b/a.zarr") as source:
        source.read(Box((0, 0, 0), (1, 1, 1)))
        shutil.rmtree(folder / "0" / "c")
        with pytest.raises(SourceUnreachableError, match=r"0/c/0/0/0 was there"):
            source.read(Box((0, 0, 0), (8, 16, 8)))


def test_a_source_that_changes_while_it_is_read_is_refused(web, folder, voxels, monkeypatch):
    monkeypatch.setattr("octobrick.store.sources.remote_store._CHECK_SECONDS", 0)
    image(folder, voxels)
    with open_source(f"{web.url}/b/a.zarr") as source:
        read_all(source)
        os.utime(folder / "0" / "zarr.json", ns=(1, 1))
        with pytest.raises(SourceMismatchError, match=r"0/zarr.json was changed while"):
            read_all(source)


def test_what_came_is_kept_for_boxes_that_share_it_up_to_a_limit(web, folder, voxels, monkeypatch):
    image(folder, voxels, shards=(8, 16, 16))
    with open_source(f"{web.url}/b/a.zarr") as source:
        corner = Box((0, 0, 0), (1, 1, 1))
        source.read(corner)
        before = len(web.asked)
        source.read(corner)
        assert len(web.asked) == before
        monkeypatch.setattr("octobrick.store.sources.remote_store._KEPT_NBYTES", 800)
        for z in range(SHAPE[0]):
            source.read(Box((z, 0, 0), (z + 1, *SHAPE[1:])))
            assert source._remote._kept_nbytes <= 800
            kept = source._remote._kept.values()
            assert sum(map(len, kept)) == source._remote._kept_nbytes


# Fingerprints


def test_the_fingerprint_tells_of_metadata_that_were_written_again(address, folder, voxels):
    image(folder, voxels)
    with open_source(address) as source, open_source(address) as other:
        before = source.fingerprint()
        assert other.fingerprint() == before
        assert before["modified"].startswith("20")
    os.utime(folder / "0" / "zarr.json", ns=(1, 1))
    with open_source(address) as source:
        assert source.fingerprint() != before


# S3


@pytest.fixture
def bucket(web, monkeypatch):
    monkeypatch.setenv("AWS_ENDPOINT_URL", web.url)
    return web


def test_requests_to_s3_are_signed_where_there_are_credentials(bucket, folder, voxels, monkeypatch):
    image(folder, voxels)
    with open_source("s3://b/a.zarr") as source:
        read_all(source)
    assert not any("authorization" in headers for _, _, headers in bucket.asked)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "me")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("AWS_REGION", "eu-north-1")
    bucket.asked.clear()
    with open_source("s3://b/a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    for _, _, headers in bucket.asked:
        assert "Credential=me/" in headers["authorization"]
        assert "/eu-north-1/s3/" in headers["authorization"]


def test_a_bucket_that_refuses_what_is_not_there_is_read(bucket, folder, voxels):
    image(folder, voxels, version=2)

    def refuse(handler):
        missing = not (bucket.folder / handler.path.lstrip("/")).is_file()
        return missing and status(403)(handler)

    bucket.trick = refuse
    with open_source("s3://b/a.zarr") as source:
        np.testing.assert_array_equal(read_all(source), voxels)
    with pytest.raises(SourceUnreachableError, match="without credentials: set AWS_ACCESS_KEY_ID"):
        open_source("s3://b/other.zarr")
    (folder / "0" / "1.1.1").unlink()
    with open_source("s3://b/a.zarr") as source, pytest.raises(SourceUnreachableError, match="403"):
        read_all(source)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"AWS_PROFILE": "mine"}, "profiles are not read"),
        ({"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}, "these credentials"),
    ],
)
def test_a_refusal_of_s3_says_what_to_set(bucket, monkeypatch, settings, text):
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    bucket.trick = status(403)
    with pytest.raises(SourceUnreachableError, match=rf"s3://b/a\.zarr: .*403.*{text}"):
        open_source("s3://b/a.zarr")


def test_a_bucket_of_another_region_says_so(bucket):
    bucket.trick = status(301)
    with pytest.raises(SourceUnreachableError, match=r"another region.*AWS_REGION"):
        open_source("s3://b/a.zarr")
