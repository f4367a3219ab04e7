"""OpenVDB grids: against OpenVDB's own Python module where it is, and what is refused."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source
from octobrick.store.vdb_writer import write_vdb

from .writers_openvdb import HAS_OPENVDB

SYSTEM_PYTHON = Path("/usr/bin/python3")
CLOUD = Path(__file__).resolve().parents[4] / "shared/data/vdb_wdas_cloud_sixteenth.vdb"

needs_extension = pytest.mark.skipif(not HAS_OPENVDB, reason="built without OpenVDB")


def by_pyopenvdb(script: str, *arguments: object) -> str:
    """What a script for OpenVDB's own module prints; it crashes beside numpy 2, so not in here."""
    command = [str(SYSTEM_PYTHON), "-c", "import pyopenvdb as vdb, sys, json\n" + script]
    try:
        run = subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("no system Python")
    if "No module named 'pyopenvdb'" in run.stderr:
        pytest.skip("no python3-openvdb")
    assert run.returncode == 0, run.stderr
    return run.stdout


@needs_extension
@pytest.mark.shared
@pytest.mark.skipif(not CLOUD.is_file(), reason="no real volumes beside the checkout")
def test_active_voxels_of_the_cloud_equal_openvdb(tmp_path):
    by_pyopenvdb(
        """
grid = vdb.read(sys.argv[1], "density")
with open(sys.argv[2], "w") as out:
    for item in grid.citerOnValues():
        print(*item.min, *item.max, item.value.hex(), file=out)
""",
        CLOUD,
        tmp_path / "active",
    )
    expected = np.zeros((154, 86, 126), np.float32)
    active = np.zeros(expected.shape, bool)
    for line in (tmp_path / "active").read_text().splitlines():
        *place, value = line.split()
        x0, y0, z0, x1, y1, z1 = map(int, place)
        part = np.s_[z0 + 90 : z1 + 91, y0 + 21 : y1 + 22, x0 + 66 : x1 + 67]
        expected[part], active[part] = float.fromhex(value), True
    assert active.sum() == 415_642
    with open_source(CLOUD) as source:
        assert source.shape_zyx == expected.shape
        assert source.spacing_zyx == pytest.approx((10 / 3,) * 3)
        assert source.origin_xyz == pytest.approx((-220.0, -70.0, -300.0), abs=1e-4)
        voxels = source.read(Box.of_shape(source.shape_zyx))
    np.testing.assert_array_equal(voxels[active], expected[active])
    assert not voxels[~active].any()


@needs_extension
@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize("kind", ["FloatGrid", "BoolGrid", "Vec3SGrid"])
def test_grids_that_openvdb_writes_are_read(tmp_path, kind, half):
    path = tmp_path / "a.vdb"
    by_pyopenvdb(
        """
path, kind, half = sys.argv[1:]
grid = getattr(vdb, kind)()
value = {"FloatGrid": 0.1, "BoolGrid": True, "Vec3SGrid": (0.5, -2, 3)}[kind]
grid.fill((-9, 0, 2), (40, 20, 30), value, True)
grid.getAccessor().setValueOff((0, 1, 3))
grid.name, grid.saveFloatAsHalf = "g", half == "True"
grid.transform = vdb.createLinearTransform(0.25)
vdb.write(path, grid)
""",
        path,
        kind,
        half,
    )
    with open_source(path, dataset="g") as source:
        assert source.shape_zyx == (29, 21, 50)
        assert source.spacing_zyx == (0.25, 0.25, 0.25)
        assert source.origin_xyz == (-2.25, 0.0, 0.5)
        voxels = source.read_channels(Box.of_shape(source.shape_zyx))
    expected = {"FloatGrid": [0.1], "BoolGrid": [True], "Vec3SGrid": [0.5, -2, 3]}[kind]
    if half and kind == "FloatGrid":
        expected = [float(np.float16(0.1))]
    assert voxels.shape == (len(expected), 29, 21, 50)
    for channel, value in zip(voxels, expected, strict=True):
        np.testing.assert_array_equal(channel, channel.dtype.type(value))


@needs_extension
def test_what_is_written_is_the_same_to_openvdb(tmp_path):
    path = tmp_path / "a.vdb"
    voxels = np.arange(4 * 5 * 6, dtype=np.float32).reshape(4, 5, 6)
    count = write_vdb(
        path,
        [((10, 20, 30), voxels)],
        dtype="float32",
        name="smoke",
        active=(7, 100),
        spacing_zyx=(3, 2, 1),
        origin_xyz=(5, 6, 7),
    )
    assert count == 94
    seen = json.loads(
        by_pyopenvdb(
            """
grid = vdb.read(sys.argv[1], "smoke")
read = grid.getConstAccessor()
place = lambda x, y, z: list(grid.transform.indexToWorld((x, y, z)))
print(json.dumps({
    "count": grid.activeVoxelCount(),
    "values": [read.getValue(at) for at in ((30, 20, 10), (31, 21, 10), (35, 24, 13))],
    "world": [place(0, 0, 0), place(1, 1, 1)],
    "class": grid.gridClass,
}))
""",
            path,
        )
    )
    assert seen == {
        "count": 94,
        "values": [0.0, 7.0, 0.0],
        "world": [[5.0, 6.0, 7.0], [6.0, 8.0, 10.0]],
        "class": "fog volume",
    }


@needs_extension
@pytest.mark.parametrize("dtype", ["bool", "int32", "int64", "float32", "float64"])
def test_every_type_of_grid_comes_back(tmp_path, dtype):
    bits = np.random.default_rng(3).integers(
        0, 256, (9, 10, 11, np.dtype(dtype).itemsize), np.uint8
    )
    voxels = bits[..., 0] > 9 if dtype == "bool" else np.nan_to_num(bits.view(dtype)[..., 0])
    write_vdb(tmp_path / "a.vdb", [((0, 0, 0), voxels)], dtype=dtype)
    with open_source(tmp_path / "a.vdb") as source:
        read = source.read(Box.of_shape(source.shape_zyx))
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, voxels)


@needs_extension
def test_inside_of_a_level_set_has_its_own_sign(tmp_path):
    path = tmp_path / "a.vdb"
    by_pyopenvdb(
        "vdb.write(sys.argv[1], vdb.createLevelSetSphere(radius=30, voxelSize=1, halfWidth=3))",
        path,
    )
    with open_source(path) as source:
        assert source.background == 3
        voxels = source.read(Box.of_shape(source.shape_zyx))
        nz, ny, nx = (size // 2 for size in source.shape_zyx)
        assert source.constant(Box((nz, ny, nx), (nz + 4, ny + 4, nx + 4))) == -3
    assert voxels[0, 0, 0] == 3
    assert voxels[nz, ny, nx] == -3


@needs_extension
def test_far_voxels_stay_sparse_and_space_between_is_known_to_be_constant(tmp_path):
    one = np.ones((1, 1, 1), np.float32)
    far = 1 << 20
    write_vdb(
        tmp_path / "a.vdb",
        [((0, 0, 0), one), ((far, far, far), 2 * one)],
        dtype="float32",
        background=-1,
    )
    with open_source(tmp_path / "a.vdb") as source:
        assert source.shape_zyx == (far + 1,) * 3
        assert source.background == -1
        assert source.constant(Box((8, 8, 8), (4096, 4096, 4096))) == -1
        assert source.constant(Box((0, 0, 0), (64, 64, 64))) is None
        corner = source.read(Box((far - 1, far - 1, far - 1), (far + 1, far + 1, far + 1)))
    assert corner.ravel().tolist() == [-1] * 7 + [2]


@needs_extension
def test_grid_without_active_voxels_is_refused(tmp_path):
    write_vdb(tmp_path / "a.vdb", [], dtype="float32")
    with pytest.raises(SourceError, match="'density' has no active voxel"):
        open_source(tmp_path / "a.vdb")


@needs_extension
def test_one_of_several_grids_is_chosen_by_name(tmp_path):
    path = tmp_path / "a.vdb"
    by_pyopenvdb(
        """
grids = [vdb.FloatGrid(1), vdb.BoolGrid(), vdb.FloatGrid(2)]
for grid, name in zip(grids, ["a", "b", "b"]):
    grid.name = name
    grid.fill((0, 0, 0), (1, 1, 1), 1, True)
vdb.write(sys.argv[1], grids)
""",
        path,
    )
    with pytest.raises(InvalidInputError, match=r"several grids; .*: a \(float\), b\[0\] \(bool\)"):
        open_source(path)
    with pytest.raises(InvalidInputError, match="no grid 'c'"):
        open_source(path, dataset="c")
    with open_source(path, dataset="b[1]") as source:
        assert source.background == 2


@needs_extension
def test_axes_are_not_asked_for(tmp_path):
    write_vdb(tmp_path / "a.vdb", [((0, 0, 0), np.ones((1, 1, 1), bool))], dtype="bool")
    with pytest.raises(InvalidInputError, match="--axes"):
        open_source(tmp_path / "a.vdb", axes="zyx")


@needs_extension
def test_newer_version_of_the_format_is_refused(tmp_path):
    path = tmp_path / "a.vdb"
    path.write_bytes(b" BDV\0\0\0\0" + (999).to_bytes(4, "little") + bytes(100))
    with pytest.raises(UnsupportedSourceError, match=r"version 999 .* 222 to 224"):
        open_source(path)


@needs_extension
def test_file_that_is_cut_short_names_both_ends(tmp_path):
    path = tmp_path / "a.vdb"
    write_vdb(path, [((0, 0, 0), np.ones((9, 9, 9), np.float32))], dtype="float32")
    whole = path.read_bytes()
    path.write_bytes(whole[:-20])
    found = rf"ends at byte {len(whole)}, the file at {len(whole) - 20}"
    with pytest.raises(TruncatedSourceError, match=found):
        open_source(path)


def test_without_the_extension_the_remedy_is_named(tmp_path, monkeypatch):
    (tmp_path / "a.vdb").write_bytes(b" BDV\0\0\0\0")
    monkeypatch.setitem(__import__("sys").modules, "octobrick.store._vdb", None)
    with pytest.raises(ResourceError, match=r"a\.vdb: .* apt-get install libopenvdb-dev"):
        open_source(tmp_path / "a.vdb")
