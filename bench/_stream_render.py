"""Pictures of one view from a cold start, run behind a shaped link: see service_stream.py."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from _clients import Client
from _shaped_link import received_nbytes

from octobrick.renderer import Camera, RenderedImage, Renderer, TransferFunction, frames
from octobrick.store import Volume, open_volume
from octobrick.store.box import Zyx

SIDE = 512
CONNECTIONS = 6


def main() -> None:
    """way, host, port, folder of the same volumes → figures as JSON."""
    way, host, port, served = sys.argv[1:]
    os.environ["OCTOBRICK_CACHE_NBYTES"] = "0"
    name = "raw" if way == "render-raw" else "head"
    with (
        open_volume(Path(served) / f"{name}.zarr") as local,
        Renderer(threads=CONNECTIONS) as renderer,
    ):
        *_, (_, expected) = drawn(renderer, Renamed(local))  # makes all shaders, too
        renderer.forget_bricks()
        figures, last = rendered(renderer, way, local, (host, int(port)), name)
    if not np.array_equal(last.premultiplied, expected.premultiplied):
        raise SystemExit(f"{way}: not the picture of the volume on disk")
    print(json.dumps(figures))


class OneByOne:
    """A volume without batches."""

    def __init__(self, volume: Volume) -> None:
        self._volume = volume

    def __getattr__(self, name: str) -> Any:
        if name == "brick_codes":
            raise AttributeError(name)
        return getattr(self._volume, name)


class Renamed(OneByOne):
    """Other addresses for the same bricks, so that what a renderer keeps of them is of no use."""

    revision = "renamed"


class Plain(OneByOne):
    """Raw voxels, one request each without zstd; of a volume whose bricks have no codec."""

    def __init__(self, volume: Volume, server: tuple[str, int], name: str) -> None:
        super().__init__(volume)
        self._server = server
        self._path = f"/v1/volumes/{name}/{volume.revision}/bricks"
        self._own = threading.local()

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """As a `BrickSource` has it."""
        if not hasattr(self._own, "client"):
            self._own.client = Client(*self._server)
        path = "/".join(map(str, (self._path, level, t, c, *zyx)))
        reply = self._own.client.ask("GET", path, accept_encoding="identity")
        assert reply.status in (200, 204), reply
        assert "content-encoding" not in reply.headers, "it came compressed"
        return reply.body if reply.status == 200 else None


def rendered(
    renderer: Renderer, way: str, local: Volume, server: tuple[str, int], name: str
) -> tuple[dict[str, Any], RenderedImage]:
    """From opening the volume to the converged picture, and that picture."""
    host, port = server
    before, begin = received_nbytes(), time.perf_counter()
    first, pictures = None, 0
    with open_volume(f"http://{host}:{port}/v1/volumes/{name}") as volume:
        source: Any = volume
        if way == "render-single":
            source = OneByOne(volume)
        elif way == "render-raw":
            source = Plain(volume, server, name)
        elif way == "render-disk":
            source = local
        for now, image in drawn(renderer, source):
            pictures += 1
            if first is None and image.premultiplied.any():
                first = now
        end = now
    assert first is not None, "the picture is empty"
    figures = {
        "pictures": pictures,
        "bricks": image.stats.bricks["sampled"],
        "first_seconds": first - begin,
        "all_seconds": end - begin,
        "link_nbytes": received_nbytes() - before,
    }
    return figures, image


def drawn(renderer: Renderer, source: Any) -> Any:
    """When each picture was there, and the picture."""
    function = TransferFunction.preset("ct-bone")
    camera = Camera.orbit(source, 30, 15)
    for image in frames(renderer, source, camera, function, (SIDE, SIDE), level=0):
        yield time.perf_counter(), image


if __name__ == "__main__":
    main()
