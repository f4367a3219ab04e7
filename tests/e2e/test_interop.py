"""Existing readers, as they are, read our volumes over a real socket: values as `Volume.read`."""

from __future__ import annotations

import http.client
import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import obstore.store
import pytest
import tensorstore
import tifffile
import zarr
import zstandard
from zarr.storage import ObjectStore

from octobrick.codec import S3dc, Zerobit
from octobrick.store import Volume, ingest, open_volume

WAIT_SECONDS = 30  # only a failing test waits as long
# Odd sizes: bricks at every border are cut, and no two levels end alike.
SHAPE_ZYX = (37, 50, 41)
VOLUMES: dict[str, tuple[str, int, int, Any]] = {
    # name: sample type, time steps, channels, codec
    "u8": ("uint8", 1, 3, S3dc(bits=4)),
    "u16": ("uint16", 2, 2, S3dc((4, 4, 4), max_error=3)),
    "i16": ("int16", 1, 1, Zerobit(ratio=0.1)),
    "f32": ("float32", 1, 1, S3dc(bits=8)),
    "exact": ("int16", 2, 1, None),
}


def voxels(dtype: str, nt: int, nc: int) -> np.ndarray[Any, Any]:
    """(t, c, z, y, x): waves that differ in every step and channel, with bricks of nothing."""
    t, c, z, y, x = np.ogrid[:nt, :nc, : SHAPE_ZYX[0], : SHAPE_ZYX[1], : SHAPE_ZYX[2]]
    wave = np.sin(0.13 * z + 0.6 * t) + np.cos(0.09 * y - c) + np.sin(0.11 * x + 0.4 * c)
    low = 0 if dtype.startswith("u") else -90
    out = np.clip(wave * 40 + 100 + low, low, 250).astype(dtype)
    out[:, :, :16, 16:32, :] = 0  # absent bricks, at level 0
    out[:, 0, 16:32] = 0  # present in other channels only
    return out


@dataclass(frozen=True)
class Server:
    folder: Path
    port: int

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def volume(self, name: str) -> Volume:
        return open_volume(self.folder / f"{name}.zarr")

    def request(
        self, target: str, method: str = "GET", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """One request with its target as it is: status, headers and body."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_SECONDS)
        try:
            connection.putrequest(method, target, skip_accept_encoding=True)
            for name, value in headers.items():
                connection.putheader(name.replace("_", "-"), value)
            connection.endheaders()
            reply = connection.getresponse()
            names = {name.lower(): value for name, value in reply.getheaders()}
            return reply.status, names, reply.read()
        finally:
            connection.close()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("interop")
    for name, (dtype, nt, nc, codec) in VOLUMES.items():
        source = folder / f"{name}.ome.tif"
        tifffile.imwrite(source, voxels(dtype, nt, nc), ome=True, metadata={"axes": "TCZYX"})
        ingest(source, folder / f"{name}.zarr", codec=codec, brick=16, shard=2, workers=1)
    labels = voxels("uint8", 1, 1)[0, 0]
    np.save(folder / "labels.npy", labels)
    ingest(folder / "labels.npy", folder / "labels.zarr", labels=True, brick=16, workers=1)
    log = folder / "log"  # not a pipe: it has a line for each request, and nobody reads it
    with log.open("w") as stderr:
        process = subprocess.Popen(
            [sys.executable, "-m", "octobrick.server.cli", "serve", str(folder), "--port", "0"],
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
        )
    try:
        assert process.stdout
        line = process.stdout.readline()
        assert " at http://127.0.0.1:" in line, line or process.communicate()[1]
        yield Server(folder, int(line.rsplit(":", 1)[1]))
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=WAIT_SECONDS)
        assert "Traceback" not in log.read_text()
    finally:
        process.kill()
        process.communicate()


def places(volume: Volume) -> Iterator[tuple[int, int, int]]:
    """Every level, time step and channel."""
    yield from np.ndindex(len(volume.levels), volume.nt, volume.nc)


@pytest.mark.parametrize("name", VOLUMES)
@pytest.mark.parametrize(("route", "zarr_format"), [("zarr", 3), ("zarr2", 2)])
def test_zarr_python_reads_every_level_as_we_do(
    server: Server, name: str, route: str, zarr_format: Any
) -> None:
    store = obstore.store.HTTPStore.from_url(
        f"{server.url}/{route}/{name}", client_options={"allow_http": True}
    )
    group = zarr.open_group(ObjectStore(store, read_only=True), mode="r", zarr_format=zarr_format)
    with server.volume(name) as volume:
        assert sorted(dict(group.members())) == [str(i) for i in range(len(volume.levels))]
        for level, t, c in places(volume):
            array = group[str(level)]
            assert isinstance(array, zarr.Array)
            np.testing.assert_array_equal(array[t, c], volume.read(level, t=t, c=c), strict=True)


@pytest.mark.parametrize("name", VOLUMES)
@pytest.mark.parametrize(("route", "driver"), [("zarr", "zarr3"), ("zarr2", "zarr")])
def test_tensorstore_reads_every_level_as_we_do(
    server: Server, name: str, route: str, driver: str
) -> None:
    with server.volume(name) as volume:
        for level in range(len(volume.levels)):
            url = f"{server.url}/{route}/{name}/{level}/"
            array = open_with(driver, url)
            for t, c in np.ndindex(volume.nt, volume.nc):
                found = array[t, c].read().result()
                np.testing.assert_array_equal(found, volume.read(level, t=t, c=c), strict=True)


@pytest.mark.parametrize("name", VOLUMES)
def test_tensorstore_reads_every_scale_of_the_precomputed_volume(server: Server, name: str) -> None:
    with server.volume(name) as volume:
        for level, t, c in places(volume):
            step = f"t/{t}/" if t else ""
            url = f"{server.url}/precomputed/{name}/{step}"
            array = open_with("neuroglancer_precomputed", url, scale_index=level)
            found = array[..., c].read().result().transpose()  # x, y, z
            np.testing.assert_array_equal(found, volume.read(level, t=t, c=c), strict=True)


def open_with(driver: str, url: str, **more: Any) -> Any:
    spec = {"driver": driver, "kvstore": {"driver": "http", "base_url": url}, **more}
    return tensorstore.open(spec, read=True).result()


def test_metadata_names_standard_codecs_alone_and_places_the_levels(server: Server) -> None:
    for name in VOLUMES:
        group = json.loads(server.request(f"/zarr/{name}/zarr.json")[2])
        with server.volume(name) as volume:
            stored = zarr.open_group(volume.path, mode="r").attrs["ome"]
            assert group["attributes"] == {"ome": stored}
            for level in range(len(volume.levels)):
                array = json.loads(server.request(f"/zarr/{name}/{level}/zarr.json")[2])
                assert [codec["name"] for codec in array["codecs"]] == ["bytes", "zstd"]
                assert array == group["consolidated_metadata"]["metadata"][str(level)]
        assert "octobrick" not in json.dumps(group)


def test_a_lossless_chunk_is_the_frame_on_disk(server: Server) -> None:
    with server.volume("exact") as volume:
        stored = volume.stored_brick(0, (0, 0, 1))
    status, headers, body = server.request("/zarr/exact/0/c/0/0/0/0/1", accept_encoding="zstd")
    assert (status, body) == (200, stored)
    assert "content-encoding" not in headers, "zstd is the codec here, not for the transfer"
    status, headers, body = server.request(
        "/precomputed/exact/0/16-32_0-16_0-16", accept_encoding="zstd"
    )
    assert (status, body) == (200, stored)
    assert headers["content-encoding"] == "zstd"
    assert stored
    _, headers, plain = server.request("/precomputed/exact/0/16-32_0-16_0-16")
    assert "content-encoding" not in headers
    assert plain == zstandard.decompress(stored)


def test_absent_chunks_are_404_as_missing_files_are(server: Server) -> None:
    for target in ("/zarr/exact/0/c/0/0/0/1/0", "/precomputed/exact/0/0-16_16-32_0-16"):
        status, _, body = server.request(target)
        assert (status, json.loads(body)["error"]["kind"]) == (404, "not-found")


CHUNKS = ["/zarr/f32/0/c/0/0/0/0/0", "/zarr2/f32/0/0/0/0/0/0", "/precomputed/f32/0/0-16_0-16_0-16"]


@pytest.mark.parametrize("target", [*CHUNKS, "/zarr/f32/zarr.json", "/precomputed/f32/info"])
def test_a_known_copy_is_304_and_head_has_the_headers_of_get(server: Server, target: str) -> None:
    status, headers, body = server.request(target)
    assert (status, headers["cache-control"]) == (200, "no-cache")
    assert server.request(target, if_none_match=headers["etag"])[::2] == (304, b"")
    status, of_head, nothing = server.request(target, "HEAD")
    assert (status, nothing) == (200, b"")
    for name in ("content-length", "etag", "content-type"):
        assert of_head[name] == headers[name]
    assert headers["content-length"] == str(len(body))


@pytest.mark.parametrize("target", CHUNKS)
def test_a_range_of_a_chunk_is_206_and_an_odd_one_is_the_whole(server: Server, target: str) -> None:
    _, headers, body = server.request(target)
    for asked, start, stop in [
        ("bytes=0-9", 0, 10),
        ("bytes=5-", 5, len(body)),
        ("bytes=-7", len(body) - 7, len(body)),
        (f"bytes=3-{10**17}", 3, len(body)),
    ]:
        status, of_part, part = server.request(target, range=asked)
        assert (status, part) == (206, body[start:stop])
        assert of_part["content-range"] == f"bytes {start}-{stop - 1}/{len(body)}"
    for asked in ("bytes=0-1,5-6", f"bytes={len(body)}-", "bytes=9-2", "lines=0-9", "bytes=-", "x"):
        assert server.request(target, range=asked)[::2] == (200, body)
    assert server.request(target, range="bytes=0-9", if_range='"old"')[0] == 200
    assert server.request(target, range="bytes=0-9", if_range=headers["etag"])[0] == 206


def test_a_pinned_revision_can_be_kept_for_ever_and_another_is_gone(server: Server) -> None:
    with server.volume("u8") as volume:
        revision = volume.revision
    for key in ("0/c/0/0/0/0/0", "zarr.json"):
        status, headers, _ = server.request(f"/zarr/u8@{revision}/{key}")
        assert status == 200
        assert "immutable" in headers["cache-control"]
        status, _, body = server.request(f"/zarr/u8@{'0' * 32}/{key}")
        assert (status, json.loads(body)["error"]["kind"]) == (410, "revision-gone")


def test_labels_are_a_segmentation_and_sizes_are_in_nanometres(server: Server) -> None:
    info = json.loads(server.request("/precomputed/labels/info")[2])
    assert (info["type"], info["data_type"], info["num_channels"]) == ("segmentation", "uint8", 1)
    info = json.loads(server.request("/precomputed/u8/info")[2])
    assert (info["type"], info["num_channels"]) == ("image", 3)
    assert [scale["voxel_offset"] for scale in info["scales"]] == [[0, 0, 0]] * len(info["scales"])
    assert info["scales"][0]["size"] == list(reversed(SHAPE_ZYX))
    with server.volume("u8") as volume:
        assert volume.unit is None
        for scale, level in zip(info["scales"], volume.levels, strict=True):
            assert tuple(scale["resolution"]) == level.spacing_xyz  # one world unit, one nanometre


BAD_TARGETS = [
    ("/zarr/tail/zarr.json", 404, "volume-not-found"),
    ("/zarr/u8/", 404, "not-found"),
    ("/zarr/u8", 404, "route-not-found"),
    ("/zarr/u8/.zgroup", 404, "not-found"),
    ("/zarr/u8/manifest.json", 404, "not-found"),
    ("/zarr/u8/range/0/zarr.json", 404, "not-found"),
    ("/zarr/u8/9/zarr.json", 404, "not-found"),
    ("/zarr/u8/00/zarr.json", 404, "not-found"),
    ("/zarr/u8/0/c/0/0/0/0/9", 404, "not-found"),
    ("/zarr/u8/0/c/0/9/0/0/0", 404, "not-found"),
    ("/zarr/u8/0/c/9/0/0/0/0", 404, "not-found"),
    ("/zarr/u8/0/c/0/0/0/0/-1", 404, "not-found"),
    ("/zarr/u8/0/c/0/0/0/0/00", 404, "not-found"),
    ("/zarr/u8/0/c/0/0/0/0/" + "9" * 5000, 404, "not-found"),
    ("/zarr/u8/../u16/zarr.json", 404, "not-found"),
    ("/zarr/..%2fu8/zarr.json", 422, "invalid-input"),
    ("/zarr/u8/0/c%2f0/0/0/0/0", 422, "invalid-input"),
    ("/zarr/u8@/zarr.json", 410, "revision-gone"),
    ("/zarr/u8@../zarr.json", 410, "revision-gone"),
    ("/precomputed/u8/t/1/info", 404, "not-found"),
    ("/precomputed/u8/t/01/info", 404, "not-found"),
    ("/precomputed/u8/9/0-16_0-16_0-16", 404, "not-found"),
    ("/precomputed/u8/0/0-16_0-16_0-17", 404, "not-found"),
    ("/precomputed/u8/0/8-24_0-16_0-16", 404, "not-found"),
    ("/precomputed/u8/0/32-48_0-16_0-16", 404, "not-found"),  # padded: the volume ends at 41
    ("/precomputed/u8/0/0-0_0-0_0-0", 404, "not-found"),
    ("/precomputed/u8/0/9999999999-9999999999_0-16_0-16", 404, "not-found"),
    ("/precomputed/u8/../../etc/passwd", 404, "not-found"),
]


@pytest.mark.parametrize(("target", "status", "kind"), BAD_TARGETS)
def test_a_key_that_names_nothing_has_the_one_error_shape(
    server: Server, target: str, status: int, kind: str
) -> None:
    found, headers, body = server.request(target)
    assert (found, json.loads(body)["error"]["kind"]) == (status, kind)
    assert headers["content-type"] == "application/json"
    assert str(server.folder) not in body.decode()
