"""Writes tests/golden/brick_stream/, byte by byte as docs/spec/brick-stream.md says.

    python tests/golden/make_brick_stream.py

Tests read these files and never write them. NAME.stream is a stream; streams.json lists for each
its kind, its count, and of each record the status and the payload in hexadecimal.
"""

from __future__ import annotations

import json
from pathlib import Path

import google_crc32c
import zstandard

FOLDER = Path(__file__).parent / "brick_stream"

Records = list[tuple[int, bytes]]


def frame(content: bytes) -> bytes:
    """A zstd frame with a checksum."""
    return zstandard.ZstdCompressor(level=3, write_checksum=True).compress(content)


def stream(kind: int, records: Records) -> bytes:
    """A stream, written out without the code that it is to test."""
    out = b"OBKS" + bytes([1, kind, 0, 0]) + number(len(records)) + number(0)
    for index, (status, payload) in enumerate([*records, (255, b"")]):
        out += number(index) + bytes([status, 0, 0, 0]) + number(len(payload))
        out += number(google_crc32c.value(payload) if payload else 0) + payload
    return out


def number(value: int) -> bytes:
    """Four bytes."""
    return value.to_bytes(4, "little")


ERROR = b'{"error":{"kind":"corrupt-brick","message":"It is damaged.","facts":{}}}'
CASES: dict[str, tuple[int, Records]] = {
    "nothing": (0, []),
    "absent": (0, [(1, b"")]),
    "voxels": (0, [(0, frame(bytes(range(64)))), (1, b""), (2, ERROR), (0, frame(bytes(512)))]),
    "gradients": (1, [(1, b""), (0, frame(b"\x80\x80\x81" * 64))]),
}

if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    listed = []
    for name, (kind, records) in CASES.items():
        (FOLDER / f"{name}.stream").write_bytes(stream(kind, records))
        pairs = [[status, payload.hex()] for status, payload in records]
        listed.append(json.dumps({"name": name, "kind": kind, "records": pairs}))
    lines = ",\n  ".join(listed)
    (FOLDER / "streams.json").write_text(f'{{"version": 1, "streams": [\n  {lines}\n]}}\n')
