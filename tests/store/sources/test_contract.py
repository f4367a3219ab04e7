"""What every source promises, whatever its format: `SourceContract` runs over all writers."""

from __future__ import annotations

import json
import threading

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Box
from octobrick.store.sources import open_source

from .conftest import make_voxels
from .sample import dtypes_of

SHAPE = (4, 5, 37)


def _axis(size: int) -> st.SearchStrategy[tuple[int, int]]:
    ends = st.tuples(st.integers(0, size), st.integers(0, size))
    return ends.map(sorted).filter(lambda pair: pair[0] < pair[1]).map(tuple)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    (z0, z1), (y0, y1), (x0, x1) = (draw(_axis(size)) for size in SHAPE)
    return Box((z0, y0, x0), (z1, y1, x1))


class TestSourceContract:
    def test_describes_the_volume_as_it_was_written(self, sample):
        with open_source(sample.path, **sample.options) as source:
            assert source.shape_zyx == sample.voxels.shape
            assert source.dtype == sample.voxels.dtype
            assert source.dtype.isnative
            assert source.spacing_zyx == pytest.approx((2.5, 0.75, 0.5))
            assert source.rescale is None
            assert source.warnings == ()

    def test_description_is_json_and_names_the_file_without_its_folder(self, sample):
        with open_source(sample.path, **sample.options) as source:
            described = json.loads(json.dumps(source.describe()))
        assert described["file"] == sample.path.name
        assert described["shape_zyx"] == list(sample.voxels.shape)
        assert described["dtype"] == sample.voxels.dtype.name
        assert described["format"]

    def test_whole_volume_of_every_type_equals_what_was_written(self, tmp_path, writer, dtype):
        if dtype not in dtypes_of(writer):
            pytest.skip("the format has no such sample type")
        voxels = make_voxels(dtype, (2, 3, 5))
        sample = writer(tmp_path, voxels)
        with open_source(sample.path, **sample.options) as source:
            read = source.read(Box.of_shape(source.shape_zyx))
        assert read.dtype == voxels.dtype
        np.testing.assert_array_equal(read, voxels)

    @settings(
        max_examples=12,
        deadline=None,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
    @given(wanted=st.lists(boxes(), min_size=1, max_size=6))
    def test_any_boxes_in_any_order_equal_the_array(self, buffers, sample, wanted):
        with open_source(sample.path, **sample.options) as source:
            for box in wanted:
                read = source.read(box)
                assert read.flags.c_contiguous
                assert read.dtype.isnative
                np.testing.assert_array_equal(read, sample.voxels[box.slices])

    def test_planes_read_downwards_equal_the_array(self, buffers, sample):
        nz, ny, nx = sample.voxels.shape
        with open_source(sample.path, **sample.options) as source:
            for z in reversed(range(nz)):
                plane = source.read(Box((z, 0, 0), (z + 1, ny, nx)))
                np.testing.assert_array_equal(plane[0], sample.voxels[z])

    @pytest.mark.parametrize(
        "box",
        [
            Box((1, 1, 1), (1, 2, 2)),
            Box((2, 0, 0), (1, 5, 37)),
            Box((0, 0, 0), (5, 5, 37)),
            Box((-1, 0, 0), (1, 5, 37)),
        ],
        ids=["empty", "inside-out", "beyond-the-end", "before-the-start"],
    )
    def test_box_that_is_empty_or_outside_is_refused(self, sample, box):
        with (
            open_source(sample.path, **sample.options) as source,
            pytest.raises(InvalidInputError, match=sample.path.name),
        ):
            source.read(box)

    def test_closing_twice_is_nothing_and_reading_then_is_refused(self, sample):
        source = open_source(sample.path, **sample.options)
        source.close()
        source.close()
        with pytest.raises(InvalidInputError, match="closed"):
            source.read(Box((0, 0, 0), (1, 1, 1)))

    def test_threads_that_read_at_once_get_their_own_boxes(self, sample):
        nz, ny, nx = sample.voxels.shape
        wrong: list[int] = []

        def read_planes(source, order):
            for z in order:
                plane = source.read(Box((z, 0, 0), (z + 1, ny, nx)))
                if not np.array_equal(plane[0], sample.voxels[z]):
                    wrong.append(z)

        with open_source(sample.path, **sample.options) as source:
            orders = [list(range(nz)) * 4, list(reversed(range(nz))) * 4]
            threads = [threading.Thread(target=read_planes, args=(source, o)) for o in orders]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        assert wrong == []

    def test_a_corrected_spacing_takes_the_place_of_the_header(self, sample):
        options = sample.options | {"spacing_zyx": (3, 2, 1)}
        with open_source(sample.path, **options) as source:
            assert source.spacing_zyx == (3.0, 2.0, 1.0)

    def test_a_corrected_spacing_that_is_no_size_is_refused(self, sample):
        with pytest.raises(InvalidInputError, match="spacing"):
            open_source(sample.path, **sample.options | {"spacing_zyx": (1, 0, 1)})
