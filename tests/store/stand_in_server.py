"""A small server of one volume, as docs/http.md says, that can be told to misbehave."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from octobrick.store import LocalVolume
from octobrick.store.brick_stream import Kind, Status, pack_end, pack_header, pack_record
from octobrick.store.frame import compress

Fault = Callable[["Handler"], bool]
"""Answers a request in its own way and returns True, or leaves it to the usual one."""


class StandInServer(ThreadingHTTPServer):
    """Serves a volume as ``head`` until it is closed; its log has "METHOD path" of all requests."""

    daemon_threads = True

    def __init__(self, volume: LocalVolume) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.volume = volume
        self.log: list[str] = []
        self.headers: list[dict[str, str]] = []
        self.batches: list[list[list[int]]] = []
        self.faults: list[Fault] = []
        self.stream_fault: Callable[[Handler, int], None] | None = None
        self.damage: Callable[[bytes], bytes] = lambda stored: stored
        self.url = f"http://127.0.0.1:{self.server_address[1]}/v1/volumes/head"
        threading.Thread(target=self.serve_forever, args=(0.01,), daemon=True).start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Clients that leave are no news."""

    def close(self) -> None:
        self.shutdown()
        self.server_close()

    def requests(self, part: str) -> int:
        return sum(part in line for line in self.log)


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: StandInServer
    body = b""

    def log_message(self, *_: object) -> None: ...

    def do_GET(self) -> None:
        self._dispatch()

    def do_POST(self) -> None:
        self.body = self.rfile.read(int(self.headers["Content-Length"]))
        self._dispatch()

    def answer(self, status: int, body: bytes = b"", **headers: str) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        if status != 204:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def error(self, status: int, kind: str, message: str, **headers: str) -> None:
        fields = {"kind": kind, "message": message, "facts": {}}
        self.answer(status, json.dumps({"error": fields}).encode(), **headers)

    def chunk(self, data: bytes) -> None:
        self.wfile.write(b"%x\r\n%s\r\n" % (len(data), data))
        self.wfile.flush()

    def cut(self) -> None:
        """Break the connection off."""
        self.close_connection = True
        raise ConnectionAbortedError

    def _dispatch(self) -> None:
        server = self.server
        server.log.append(f"{self.command} {self.path}")
        server.headers.append(dict(self.headers))
        if any(fault(self) for fault in list(server.faults)):
            return
        volume = server.volume
        match self.path.removeprefix("/v1/volumes/head").strip("/").split("/"):
            case [""]:
                body = {"id": "head", "revision": volume.revision}
                self.answer(200, json.dumps(body).encode())
            case ["bricks"]:
                self._stream()
            case [revision, *_] if revision != volume.revision:
                self.error(410, "revision-gone", "another one now")
            case [_, "attributes"]:
                self.answer(200, json.dumps(volume.attributes()).encode())
            case [_, "tables", kind, level, t, c]:
                table = volume.ranges if kind == "range" else volume.fidelity
                values = table(int(level), int(t), int(c))
                little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
                self.answer(200, compress(little.tobytes(), 3), Content_Encoding="zstd")
            case [_, "bricks" | "gradients" as route, level, t, c, z, y, x]:
                stored = self._stored(route, *map(int, (level, t, c, z, y, x)))
                if stored is None:
                    self.answer(204)
                else:
                    self.answer(200, server.damage(stored), Content_Encoding="zstd")
            case _:
                self.error(404, "route-not-found", "no such route")

    def _stored(self, route: str, level: int, t: int, c: int, *zyx: int) -> bytes | None:
        volume = self.server.volume
        source = volume if route != "gradients" else volume.gradients
        assert source is not None
        z, y, x = zyx
        return source.stored_brick(level, (z, y, x), t, c)

    def _stream(self) -> None:
        asked = json.loads(self.body)
        if asked["revision"] != self.server.volume.revision:
            self.error(410, "revision-gone", "another one now")
            return
        self.server.batches.append(asked["bricks"])
        self.send_response(200)
        self.send_header("Transfer-Encoding", "chunked")
        self.end_headers()
        kind = Kind[asked["kind"].upper()]
        self.chunk(pack_header(kind, len(asked["bricks"])))
        for index, place in enumerate(asked["bricks"]):
            if self.server.stream_fault is not None:
                self.server.stream_fault(self, index)
            stored = self._stored(asked["kind"], *place)
            status = Status.ABSENT if stored is None else Status.STORED
            payload = b"" if stored is None else self.server.damage(stored)
            self.chunk(b"".join(pack_record(index, status, payload)))
        self.chunk(pack_end(len(asked["bricks"])))
        self.chunk(b"")
