"""Damaged small files of every format: an OctobrickError, or voxels of the shape promised."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import OctobrickError
from octobrick.store.box import Box
from octobrick.store.sources import open_source

FUZZ = settings(
    max_examples=20,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
# What text and binary headers are most easily upset by.
SPLICES = st.sampled_from(
    [b"", b"\0", b"\n", b"-", b"0", b"9" * 30, b"nan", b"1e400", b"\xff\xff\xff\xff", b"= : ("]
)
MOST_VOXELS = 1 << 24


def read_or_refuse(sample):
    with (
        contextlib.suppress(OctobrickError),
        open_source(sample.path, **sample.options) as source,
    ):
        # Formats with missing chunks can truly claim more than memory holds.
        shape = source.shape_zyx
        if source.shape_zyx[0] * source.shape_zyx[1] * source.shape_zyx[2] > MOST_VOXELS:
            shape = tuple(min(size, 64) for size in shape)
        voxels = source.read(Box.of_shape(shape))
        assert voxels.shape == shape
        assert voxels.dtype == source.dtype
        assert all(size > 0 for size in source.spacing_zyx)
        source.describe()


@pytest.fixture
def files(sample):
    """The bytes of every file of the sample: header and data may be two."""
    return {path: path.read_bytes() for path in sample.path.parent.rglob("*") if path.is_file()}


@FUZZ
@given(data=st.data())
def test_flipped_bytes_are_an_octobrick_error_or_read(sample, files, data):
    for path, original in files.items():
        content = bytearray(original)
        positions = st.integers(0, min(len(content), 600) - 1)
        for position in data.draw(st.lists(positions, min_size=1, max_size=4)):
            content[position] = data.draw(st.integers(0, 255))
        path.write_bytes(content)
    read_or_refuse(sample)


@FUZZ
@given(data=st.data())
def test_spliced_bytes_are_an_octobrick_error_or_read(sample, files, data):
    for path, original in files.items():
        start = data.draw(st.integers(0, min(len(original), 600)))
        stop = start + data.draw(st.integers(0, 12))
        path.write_bytes(original[:start] + data.draw(SPLICES) + original[stop:])
    read_or_refuse(sample)


@FUZZ
@given(data=st.data())
def test_truncated_data_are_an_octobrick_error(writer, sample, files, data):
    if "from_the_end" in writer.__name__:
        pytest.skip("what is counted from the end does not tell where it ought to begin")
    path = max(files, key=lambda file: len(files[file]))
    path.write_bytes(files[path][: data.draw(st.integers(0, len(files[path]) - 1))])
    with (
        pytest.raises(OctobrickError),
        open_source(sample.path, **sample.options) as source,
    ):
        source.read(Box.of_shape(source.shape_zyx))
