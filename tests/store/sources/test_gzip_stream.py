"""Compressed voxels: every way in which their data can end or break, and going back."""

from __future__ import annotations

import gzip
import zlib

import numpy as np
import pytest

from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError
from octobrick.store.sources import gzip_stream, open_source
from octobrick.store.sources.gzip_stream import GzipReader

SHAPE = (8, 16, 16)


@pytest.fixture
def noise():
    return np.random.default_rng(1).integers(0, 256, SHAPE, np.uint8)


@pytest.fixture
def write(tmp_path):
    def write_file(data: bytes):
        path = tmp_path / "a.raw.gz"
        path.write_bytes(data)
        return path

    return write_file


def read_all(path):
    with open_source(path, shape_zyx=SHAPE, dtype="uint8") as source:
        return source.read(Box.of_shape(SHAPE)), source.warnings


def test_truncated_gzip_names_the_file_and_the_byte_counts(write, noise):
    path = write(gzip.compress(noise.tobytes())[:-1000])
    with pytest.raises(TruncatedSourceError, match=r"a\.raw\.gz.*of 2048 bytes") as caught:
        read_all(path)
    assert caught.value.facts["expected_nbytes"] == 2048
    assert 900 < caught.value.facts["actual_nbytes"] < 2048 - 900


def test_planes_before_the_cut_can_be_read(write, noise, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_OUTPUT_NBYTES", 64)
    path = write(gzip.compress(noise.tobytes())[:-1000])
    with open_source(path, shape_zyx=SHAPE, dtype="uint8") as source:
        first = source.read(Box((0, 0, 0), (1, 16, 16)))
        np.testing.assert_array_equal(first[0], noise[0])
        with pytest.raises(TruncatedSourceError):
            source.read(Box((7, 0, 0), (8, 16, 16)))


def test_data_shorter_than_the_shape_name_both_byte_counts(write, noise):
    path = write(gzip.compress(noise[:6].tobytes()))
    with pytest.raises(TruncatedSourceError, match="1536 of 2048 bytes"):
        read_all(path)


@pytest.mark.parametrize("lost", [1, 4, 8])
def test_cut_checksum_is_noticed_with_the_last_voxel(write, noise, lost):
    path = write(gzip.compress(noise.tobytes())[:-lost])
    with pytest.raises(TruncatedSourceError, match="before the checksum"):
        read_all(path)


def test_damaged_checksum_is_noticed_with_the_last_voxel(write, noise, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_OUTPUT_NBYTES", 64)
    data = bytearray(gzip.compress(noise.tobytes()))
    data[-6] ^= 1
    path = write(data)
    with open_source(path, shape_zyx=SHAPE, dtype="uint8") as source:
        source.read(Box((0, 0, 0), (7, 16, 16)))
        with pytest.raises(SourceError, match=r"damaged.*incorrect data check"):
            source.read(Box((7, 0, 0), (8, 16, 16)))


def test_damaged_data_name_the_file_and_the_place(write, noise):
    data = bytearray(gzip.compress(np.sort(noise, axis=None).tobytes()))
    data[len(data) // 2] ^= 0xFF
    with pytest.raises(SourceError, match=r"a\.raw\.gz.*damaged after \d+ of 2048 bytes"):
        read_all(write(data))


def test_several_members_are_one_stream(write, noise):
    members = [gzip.compress(plane.tobytes()) for plane in noise]
    read, warnings = read_all(write(b"".join(members)))
    np.testing.assert_array_equal(read, noise)
    assert warnings == ()


def test_several_members_are_told_apart_wherever_the_file_is_cut_for_reading(
    write, noise, monkeypatch
):
    path = write(b"".join(gzip.compress(plane.tobytes()) for plane in noise))
    for nbytes in (1, 2, 3, 7):
        monkeypatch.setattr(gzip_stream, "_INPUT_NBYTES", nbytes)
        np.testing.assert_array_equal(read_all(path)[0], noise)


def test_padding_behind_the_data_is_left_alone(write, noise):
    read, warnings = read_all(write(gzip.compress(noise.tobytes()) + bytes(512)))
    np.testing.assert_array_equal(read, noise)
    assert warnings == ()


def test_bytes_behind_the_last_voxel_are_told(write, noise):
    read, warnings = read_all(write(gzip.compress(noise.tobytes() + bytes(77))))
    np.testing.assert_array_equal(read, noise)
    assert "77 bytes or more follow" in warnings[0]


def test_endless_data_behind_the_last_voxel_are_not_decoded(write, noise, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_SURPLUS_LIMIT_NBYTES", 1 << 20)
    path = write(gzip.compress(noise.tobytes() + bytes(1 << 24)))
    _, warnings = read_all(path)
    told = int(warnings[0].split()[0])
    assert 1 << 20 <= told < 1 << 22


def test_shape_that_no_file_of_this_size_can_hold_is_refused_at_once(write):
    path = write(gzip.compress(b"small"))
    with pytest.raises(TruncatedSourceError, match="at the very most"):
        open_source(path, shape_zyx=(1 << 20, 1 << 20, 1 << 20), dtype="uint8")


def test_densest_data_that_deflate_can_make_are_not_refused(write):
    shape = (64, 256, 256)
    path = write(gzip.compress(bytes(64 * 256 * 256), 9))
    with open_source(path, shape_zyx=shape, dtype="uint8") as source:
        assert not source.read(Box((63, 0, 0), (64, 256, 256))).any()


@pytest.mark.parametrize("compress", [gzip.compress, zlib.compress], ids=["gzip", "zlib"])
def test_going_back_resumes_at_a_mark_and_gives_the_same_bytes(tmp_path, compress, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_OUTPUT_NBYTES", 256)
    monkeypatch.setattr(gzip_stream, "_INPUT_NBYTES", 100)
    content = np.random.default_rng(2).integers(0, 4, 60_000, np.uint8).tobytes()
    path = tmp_path / "a"
    path.write_bytes(b"skipped" + compress(content))
    reader = GzipReader(path, 7, len(content))
    reader.seek(len(content))
    assert 50 < len(reader._marks) <= 65
    for position in (59_990, 1, 30_000, 29_999, 0, 59_999):
        reader.seek(position)
        into = bytearray(min(500, len(content) - position))
        reader.readinto(memoryview(into))
        assert into == content[position : position + len(into)]
        assert reader.position == position + len(into)
    assert len(reader._marks) <= 65
    reader.close()


def test_going_back_decodes_no_more_than_from_the_last_mark(tmp_path, monkeypatch):
    monkeypatch.setattr(gzip_stream, "_OUTPUT_NBYTES", 256)
    content = np.random.default_rng(2).integers(0, 4, 64_000, np.uint8).tobytes()
    path = tmp_path / "a"
    path.write_bytes(gzip.compress(content))
    reader = GzipReader(path, 0, len(content))
    reader.seek(len(content))
    decoded = []
    decode = reader._decode
    monkeypatch.setattr(reader, "_decode", lambda: decoded.append(decode()) or decoded[-1])
    reader.seek(40_000)
    reader.close()
    assert sum(map(len, decoded)) <= len(content) // 64 + 2 * 256
