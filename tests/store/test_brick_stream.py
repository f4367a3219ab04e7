from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from octobrick.store.brick_stream import (
    BrickStreamReader,
    Kind,
    Record,
    Status,
    pack_end,
    pack_header,
    pack_record,
    stored_nbytes_max,
)
from octobrick.store.errors import BrickStreamError
from octobrick.store.frame import compress

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests" / "golden" / "brick_stream"
STREAMS = json.loads((GOLDEN / "streams.json").read_text())["streams"]
ERROR = b'{"error":{"kind":"corrupt-brick","message":"It is damaged.","facts":{}}}'

Records = list[tuple[Status, bytes]]
RECORDS = st.lists(
    st.one_of(
        st.binary(max_size=40).map(lambda content: (Status.STORED, compress(content, 3))),
        st.just((Status.ABSENT, b"")),
        st.just((Status.FAILED, ERROR)),
    ),
    max_size=5,
)


def packed(records: Records, kind: Kind = Kind.VOXELS) -> bytes:
    parts = [pack_header(kind, len(records))]
    for index, (status, payload) in enumerate(records):
        parts += pack_record(index, status, payload)
    return b"".join([*parts, pack_end(len(records))])


def read(data: bytes, count: int, kind: Kind = Kind.VOXELS, piece: int = 1 << 20) -> list[Record]:
    reader = BrickStreamReader(kind, count, lambda _: 1000)
    found: list[Record] = []
    for at in range(0, len(data), piece):
        found += reader.feed(data[at : at + piece])
    reader.finish()
    return found


@pytest.mark.parametrize("golden", STREAMS, ids=lambda golden: golden["name"])
def test_golden_streams_are_packed_and_read_as_they_are(golden: dict[str, Any]) -> None:
    data = (GOLDEN / f"{golden['name']}.stream").read_bytes()
    pairs = [(Status(s), bytes.fromhex(p)) for s, p in golden["records"]]
    kind = Kind(golden["kind"])
    assert packed(pairs, kind) == data
    assert [(r.status, r.payload) for r in read(data, len(pairs), kind)] == pairs


def test_the_example_of_the_specification_is_a_stream() -> None:
    text = (ROOT / "docs" / "spec" / "brick-stream.md").read_text()
    found = re.search(r"## Example.*?```\n(.*?)```", text, re.DOTALL)
    assert found
    assert bytes.fromhex(found[1]) == packed([(Status.ABSENT, b"")])


@given(records=RECORDS, piece=st.integers(1, 60))
def test_a_stream_in_pieces_of_any_size_gives_its_records(records: Records, piece: int) -> None:
    found = read(packed(records), len(records), piece=piece)
    assert [(r.status, r.payload) for r in found] == records
    assert [r.index for r in found] == list(range(len(records)))


@pytest.mark.parametrize("piece", [1000, 4095, 4096, 5000, 70_000])
def test_payloads_longer_than_pieces_come_whole_whatever_becomes_of_the_pieces(piece: int) -> None:
    random = np.random.default_rng(1)
    payloads = [compress(random.bytes(n), 3) for n in (20_000, 0, 9_000, 4_096, 30_000)]
    data = packed([(Status.STORED, payload) for payload in payloads])
    reader = BrickStreamReader(Kind.VOXELS, len(payloads), lambda _: 40_000)
    found: list[Record] = []
    buffer = bytearray(piece)  # as one that is received into again and again
    for at in range(0, len(data), piece):
        part = data[at : at + piece]
        buffer[: len(part)] = part
        found += reader.feed(memoryview(buffer)[: len(part)])
    reader.finish()
    assert [record.payload for record in found] == payloads


@given(records=RECORDS, data=st.data())
@settings(max_examples=300)
def test_any_changed_byte_is_refused_and_what_came_before_is_good(
    records: Records, data: st.DataObject
) -> None:
    stream = bytearray(packed(records))
    stream[data.draw(st.integers(0, len(stream) - 1))] ^= data.draw(st.integers(1, 255))
    reader = BrickStreamReader(Kind.VOXELS, len(records), lambda _: 1000)
    found = []
    with pytest.raises(BrickStreamError):  # noqa: PT012  (it may come with any record)
        for record in reader.feed(stream):
            found.append(record)  # noqa: PERF402  (keeps those before the error)
        reader.finish()
    assert [(r.status, r.payload) for r in found] == records[: len(found)]


@given(records=RECORDS, data=st.data())
def test_any_cut_is_refused(records: Records, data: st.DataObject) -> None:
    stream = packed(records)
    with pytest.raises(BrickStreamError, match="cut off"):
        read(stream[: data.draw(st.integers(0, len(stream) - 1))], len(records))


@given(records=RECORDS, more=st.binary(min_size=1, max_size=40))
def test_bytes_after_the_end_are_refused(records: Records, more: bytes) -> None:
    with pytest.raises(BrickStreamError, match="follow"):
        read(packed(records) + more, len(records))
    with pytest.raises(BrickStreamError, match="follow"):
        read(packed(records) + more, len(records), piece=7)


def test_a_payload_that_is_too_long_is_refused_before_it_comes() -> None:
    reader = BrickStreamReader(Kind.VOXELS, 1, lambda _: stored_nbytes_max(4096))
    head = pack_record(0, Status.STORED, bytes(stored_nbytes_max(4096) + 1))[0]
    with pytest.raises(BrickStreamError, match=f"{stored_nbytes_max(4096)} at most"):
        list(reader.feed(pack_header(Kind.VOXELS, 1) + head))


def test_records_out_of_order_are_refused() -> None:
    frame = compress(b"brick", 3)
    parts = [pack_header(Kind.VOXELS, 2)]
    for index in (1, 0):
        parts += pack_record(index, Status.STORED, frame)
    with pytest.raises(BrickStreamError, match="record 1 comes where 0 should"):
        read(b"".join([*parts, pack_end(2)]), 2)


@given(st.binary(max_size=100))
def test_bytes_of_any_kind_raise_a_stream_error(data: bytes) -> None:
    with pytest.raises(BrickStreamError):
        read(data, 1)
