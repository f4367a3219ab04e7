"""Chunks decoded on the fly for Zarr and Neuroglancer readers, beside the same readers on files.

    script/bench interop_speed [--data DIR] [--quick] [--json FILE]

Serves the head CT (234×512×512 uint8, S3Dc at 4 bits) by `octobrick serve`, and exports the same
voxels as an ordinary OME-Zarr. Then, taking turns: every chunk of level 0 by four connections of
one Python client, from a server that keeps no chunk (cold) and from one that has them all (cached);
and all of level 0 into memory by TensorStore and by zarr-python (over obstore), from both servers
and from the exported files, which have the same chunks in shards. Client and servers share the
machine. MB are of voxels; the last column is the rate beside that of the same reader on the files,
of chunks alone beside TensorStore's.
"""

from __future__ import annotations

import http.client
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import _measure
import numpy as np
import tensorstore
import zarr

from octobrick.store import Volume, ingest, open_volume
from octobrick.store.export import export

CONNECTIONS = 4
LOCAL = "local files"


@contextmanager
def serving(folder: Path, cache_nbytes: int) -> Iterator[int]:
    """A server that keeps so many bytes of chunks; gives its port."""
    process = subprocess.Popen(
        [sys.executable, "-m", "octobrick.server.cli", "serve", str(folder), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"OCTOBRICK_CHUNK_CACHE_NBYTES": str(cache_nbytes)},
    )
    assert process.stdout
    try:
        yield int(process.stdout.readline().rsplit(":", 1)[1])
    finally:
        process.terminate()
        process.wait()


def targets(volume: Volume, route: str) -> list[str]:
    """The addresses of all chunks of level 0."""
    brick, shape_zyx = volume.brick_shape_zyx[0], volume.levels[0].shape_zyx
    found = []
    for zyx in np.ndindex(volume.levels[0].grid_zyx):
        if route == "zarr":
            found.append("/zarr/head/0/c/0/0/" + "/".join(map(str, zyx)))
            continue
        ends = [min((i + 1) * brick, n) for i, n in zip(zyx, shape_zyx, strict=True)]
        spans = [f"{i * brick}-{end}" for i, end in zip(zyx, ends, strict=True)]
        found.append("/precomputed/head/0/" + "_".join(reversed(spans)))
    return found


def fetch_all(port: int, wanted: list[str]) -> None:
    """Ask for chunks over a few connections that stay open."""
    local = threading.local()

    def fetch(target: str) -> None:
        if not hasattr(local, "connection"):
            local.connection = http.client.HTTPConnection("127.0.0.1", port)
        local.connection.request("GET", target, headers={"Accept-Encoding": "zstd"})
        reply = local.connection.getresponse()
        reply.read()
        if reply.status not in (200, 404):  # 404: an absent chunk
            raise RuntimeError(f"{target}: {reply.status}")

    with ThreadPoolExecutor(CONNECTIONS) as threads:
        list(threads.map(fetch, wanted))


def read_all(driver: str, kvstore: dict[str, Any]) -> np.ndarray[Any, Any]:
    """Level 0 by TensorStore, opened anew: it has a cache of its own."""
    spec = {"driver": driver, "kvstore": kvstore}
    found: np.ndarray[Any, Any] = tensorstore.open(spec, read=True).result().read().result()
    return found


def read_all_by_zarr(store: Any, path: str) -> np.ndarray[Any, Any]:
    """Level 0 by zarr-python, opened anew."""
    found = zarr.open_array(store, path=path, mode="r")[...]
    return np.asarray(found)


def zarr_over_http(port: int) -> np.ndarray[Any, Any]:
    """Level 0 by zarr-python from a server."""
    try:
        import obstore.store
    except ImportError:
        sys.exit("zarr-python reads over HTTP by obstore: pip install 'octobrick[remote]'")
    from zarr.storage import ObjectStore

    http = obstore.store.HTTPStore.from_url(
        f"http://127.0.0.1:{port}/zarr/head", client_options={"allow_http": True}
    )
    return read_all_by_zarr(ObjectStore(http, read_only=True), "0")


def run(data: Path, quick: bool) -> dict[str, Any]:
    """Seconds for all of level 0, by each way."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ingest(data / "ct_vhf_head.mhd", folder / "head.zarr")
        volume = open_volume(folder / "head.zarr")
        export(folder / "head.zarr", folder / "plain.ome.zarr")
        with serving(folder, 0) as cold, serving(folder, 2**28) as cached:
            calls = _calls(folder, volume, {"cold": cold, "cached": cached})
            for port in (cold, cached):
                for driver, path in (
                    ("zarr3", "zarr/head/0"),
                    ("neuroglancer_precomputed", "precomputed/head"),
                ):
                    kvstore = {"driver": "http", "base_url": f"http://127.0.0.1:{port}/{path}/"}
                    found = np.squeeze(read_all(driver, kvstore))
                    voxels = found if driver == "zarr3" else found.transpose()
                    np.testing.assert_array_equal(voxels, volume.read(0))
                np.testing.assert_array_equal(np.squeeze(zarr_over_http(port)), volume.read(0))
            seconds = _measure.alternating(calls, 3 if quick else 9)
        nchunks = int(np.prod(volume.levels[0].grid_zyx))
        return {"seconds": seconds, "nchunks": nchunks, "nbytes": volume.levels[0].nbytes}


def _calls(folder: Path, volume: Volume, ports: dict[str, int]) -> dict[str, Callable[[], object]]:
    calls: dict[str, Callable[[], object]] = {}
    for state, port in ports.items():
        for route in ("zarr", "precomputed"):
            wanted = targets(volume, route)
            calls[f"chunks of /{route}, {state}"] = lambda p=port, w=wanted: fetch_all(p, w)  # type: ignore[misc]
        for driver, path in (
            ("zarr3", "zarr/head/0"),
            ("neuroglancer_precomputed", "precomputed/head"),
        ):
            kvstore = {"driver": "http", "base_url": f"http://127.0.0.1:{port}/{path}/"}
            calls[f"TensorStore {driver}, {state}"] = lambda d=driver, k=kvstore: read_all(d, k)  # type: ignore[misc]
        calls[f"zarr-python, {state}"] = lambda p=port: zarr_over_http(p)  # type: ignore[misc]
    files = {"driver": "file", "path": str(folder / "plain.ome.zarr" / "0")}
    calls[f"TensorStore zarr3, {LOCAL}"] = lambda: read_all("zarr3", files)
    plain = str(folder / "plain.ome.zarr")
    calls[f"zarr-python, {LOCAL}"] = lambda: read_all_by_zarr(plain, "0")
    return calls


def table(figures: dict[str, Any]) -> str:
    """Rates, and what part of the rate from local files each is."""
    seconds = figures["seconds"]
    local = {
        reader: seconds[f"{name}, {LOCAL}"]
        for reader, name in (("TensorStore", "TensorStore zarr3"), ("zarr-python", "zarr-python"))
    }
    rows = [
        (
            name,
            f"{figures['nchunks'] / took:.0f}",
            f"{figures['nbytes'] / took / 1e6:.0f}",
            f"{local.get(name.partition(',')[0], local['TensorStore']) / took:.2f}",
        )
        for name, took in seconds.items()
    ]
    return _measure.layout(("", "chunks/s", "MB/s", "of local files"), rows)


if __name__ == "__main__":
    _measure.main(__doc__, run, table)
