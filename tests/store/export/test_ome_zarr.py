"""OME-Zarr without our codecs: TensorStore and zarr-python read every level."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tensorstore
import zarr

from octobrick.store import Box, Progress, Volume
from octobrick.store.export import export

from .conftest import DIRECTION, ORIGIN_XYZ, SPACING_XYZ, steps

Lossless = Callable[..., Volume]
SHAPE = (75, 50, 91)


def through_tensorstore(path: Path) -> Any:
    spec = {"driver": "zarr3", "kvstore": {"driver": "file", "path": str(path)}}
    return tensorstore.open(spec, read=True).result()[0, 0].read().result()


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_tensorstore_and_zarr_python_read_every_level(
    tmp_path: Path, lossless: Lossless, dtype: str
) -> None:
    voxels = steps(SHAPE, dtype)
    voxels[:40] = 0  # some chunks are absent
    out = tmp_path / "out.ome.zarr"
    with lossless(voxels) as volume:
        result = export(volume, out)
        assert result.levels == len(volume.levels) == 4
        group = zarr.open_group(out, mode="r")
        for level in volume.levels:
            expected = volume.read(level.index)
            array = group[str(level.index)]
            assert isinstance(array, zarr.Array)
            np.testing.assert_array_equal(array[0, 0], expected, strict=True)
            np.testing.assert_array_equal(
                through_tensorstore(out / str(level.index)), expected, strict=True
            )
    assert result.nbytes == sum(p.stat().st_size for p in out.rglob("*") if p.is_file())
    text = "".join(path.read_text() for path in out.rglob("zarr.json"))
    assert "octobrick" not in text.replace(volume.name, "")


def test_lossy_volumes_are_exported_decoded(tmp_path: Path, ingested: Lossless) -> None:
    with ingested(steps(SHAPE), brick=16) as volume:
        result = export(volume, tmp_path / "out.ome.zarr")
        np.testing.assert_array_equal(
            through_tensorstore(tmp_path / "out.ome.zarr" / "0"), volume.read(0)
        )
        assert result.max_error == volume.levels[0].max_error > 0


def test_levels_begin_at_the_one_that_is_asked_for(tmp_path: Path, lossless: Lossless) -> None:
    out = tmp_path / "out.zarr"
    with lossless(steps(SHAPE)) as volume:
        result = export(volume, out, level=2)
        assert (result.levels, result.level) == (2, 2)
        np.testing.assert_array_equal(through_tensorstore(out / "0"), volume.read(2))
    assert not (out / "2").exists()


def test_every_level_of_a_box_lies_where_its_voxels_are(tmp_path: Path, lossless: Lossless) -> None:
    out = tmp_path / "out.ome.zarr"
    box = Box((5, 17, 2), (36, 40, 91))
    with lossless(steps(SHAPE)) as volume:
        export(volume, out, box=box)
        ome = zarr.open_group(out, mode="r").attrs["ome"]
        assert isinstance(ome, dict)
        assert ome["version"] == "0.5"
        (image,) = ome["multiscales"]
        assert [axis["name"] for axis in image["axes"]] == ["t", "c", "z", "y", "x"]
        assert {axis.get("unit") for axis in image["axes"][2:]} == {"millimeter"}
        # The origin along the axes of the voxels, as OME-Zarr knows no directions.
        origin_zyx = np.linalg.solve(DIRECTION, ORIGIN_XYZ)[::-1]
        spacing_zyx = np.array(SPACING_XYZ[::-1])
        start = np.array(box.start_zyx)
        for index, dataset in enumerate(image["datasets"]):
            scale, translation = dataset["coordinateTransformations"]
            np.testing.assert_allclose(scale["scale"][2:], spacing_zyx * 2**index)
            center = start * 2**index + (2**index - 1) / 2
            expected = origin_zyx + center * spacing_zyx
            np.testing.assert_allclose(translation["translation"][2:], expected)
            voxels = through_tensorstore(out / str(index))
            stop = start + voxels.shape
            part = volume.read(index, Box(tuple(start.tolist()), tuple(stop.tolist())))
            np.testing.assert_array_equal(voxels, part)
            start = start // 2


def test_the_window_worth_showing_goes_along(tmp_path: Path, lossless: Lossless) -> None:
    with lossless(steps(SHAPE)) as volume:
        export(volume, tmp_path / "out.ome.zarr")
        ome: Any = zarr.open_group(tmp_path / "out.ome.zarr", mode="r").attrs["ome"]
        window = ome["omero"]["channels"][0]["window"]
        assert (window["min"], window["max"]) == volume.value_range
        assert (window["start"], window["end"]) == volume.window


def test_it_is_sharded_so_that_files_are_few(tmp_path: Path, lossless: Lossless) -> None:
    moments: list[Progress] = []
    with lossless(steps((75, 50, 300))) as volume:
        export(volume, tmp_path / "out.ome.zarr", progress=moments.append)
    files = [p for p in (tmp_path / "out.ome.zarr" / "0").rglob("*") if p.is_file()]
    assert len(files) == 2 + 1  # shards of 256³ and the metadata
    assert moments[-1].done_voxels == moments[-1].total_voxels
