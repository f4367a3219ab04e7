"""NanoVDB grids: against OpenVDB's own tool where it is, damaged nodes, and what is refused."""

from __future__ import annotations

import contextlib
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError, OctobrickError, ResourceError
from octobrick.store.box import Box
from octobrick.store.errors import SourceError, TruncatedSourceError, UnsupportedSourceError
from octobrick.store.sources import open_source
from octobrick.store.vdb_writer import write_vdb

from .writers_nanovdb import file_bytes, grid_bytes
from .writers_openvdb import HAS_OPENVDB

DATA = Path(__file__).resolve().parents[4] / "shared/data"
TOOL = shutil.which("vdb_tool")

needs_tool = pytest.mark.skipif(
    not HAS_OPENVDB or TOOL is None, reason="built without OpenVDB, or no vdb_tool"
)
VOXELS = np.random.default_rng(5).normal(size=(11, 9, 20)).astype(np.float32)


@pytest.fixture
def write(tmp_path):
    def write_file(content: bytes) -> Path:
        path = tmp_path / "a.nvdb"
        path.write_bytes(content)
        return path

    return write_file


def convert(source: Path, out: Path, *options: str) -> Path:
    """A grid in the other format, by OpenVDB's own tool."""
    assert TOOL is not None
    command = [TOOL, "-read", source, "-write", *options, out]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert out.is_file(), run.stderr
    return out


def assert_same(vdb: Path, nvdb: Path) -> None:
    """Both describe the same, and every box of one is that of the other."""
    rng = np.random.default_rng(1)
    with open_source(vdb) as expected, open_source(nvdb) as source:
        ours, theirs = source.describe(), expected.describe()
        assert ours | {"format": 0, "file": 0} == theirs | {"format": 0, "file": 0}
        assert source.background == expected.background
        whole = expected.read_channels(Box.of_shape(expected.shape_zyx))
        np.testing.assert_array_equal(source.read_channels(Box.of_shape(source.shape_zyx)), whole)
        for _ in range(30):
            ends = [sorted(rng.choice(size + 1, 2, replace=False)) for size in source.shape_zyx]
            (z0, z1), (y0, y1), (x0, x1) = ((int(a), int(b)) for a, b in ends)
            box = Box((z0, y0, x0), (z1, y1, x1))
            c = int(rng.integers(source.nc))
            np.testing.assert_array_equal(source.read(box, 0, c), whole[c][box.slices])
            assert source.constant(box, 0, c) == expected.constant(box, 0, c)


@needs_tool
@pytest.mark.parametrize(
    "options", [("codec=none",), ("codec=zip",), ("codec=blosc",)], ids=lambda given: given[0]
)
def test_what_openvdb_packs_is_the_same_grid(tmp_path, options):
    vdb = tmp_path / "a.vdb"
    pieces = [((-130, 5, 4090), VOXELS), ((900, -800, -5000), VOXELS)]
    write_vdb(vdb, pieces, dtype="float32", background=-1, spacing_zyx=(3, 2, 1))
    nvdb = convert(vdb, tmp_path / "a.nvdb", *options)
    with open_source(vdb) as expected, open_source(nvdb) as source:
        assert source.shape_zyx == expected.shape_zyx == (1041, 814, 9110)
        assert source.origin_xyz == expected.origin_xyz
        for start in ((0, 805, 9090), (1030, 0, 0), (500, 400, 4000)):
            box = Box(start, (start[0] + 11, start[1] + 9, start[2] + 20))
            np.testing.assert_array_equal(source.read(box), expected.read(box))
            assert source.constant(box) == expected.constant(box)


@needs_tool
@pytest.mark.parametrize("bits", ["16", "8", "4", "N"])
def test_quantized_values_are_to_the_bit_those_of_openvdb(tmp_path, bits):
    write_vdb(tmp_path / "a.vdb", [((-3, 5, 60), VOXELS)], dtype="float32")
    nvdb = convert(tmp_path / "a.vdb", tmp_path / "a.nvdb", f"bits={bits}")
    assert_same(convert(nvdb, tmp_path / "b.vdb"), nvdb)


@needs_tool
def test_inside_of_a_level_set_has_its_own_sign(tmp_path):
    assert TOOL is not None
    nvdb, vdb = tmp_path / "a.nvdb", tmp_path / "a.vdb"
    sphere = ["-sphere", "dim=80", "width=3"]
    subprocess.run([TOOL, *sphere, "-write", nvdb], check=True, capture_output=True)
    convert(nvdb, vdb)
    assert_same(vdb, nvdb)
    with open_source(nvdb) as source:
        nz, ny, nx = (size // 2 for size in source.shape_zyx)
        inside = source.constant(Box((nz, ny, nx), (nz + 4, ny + 4, nx + 4)))
        assert inside == -source.background < 0


@needs_tool
@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="no real volumes beside the checkout")
@pytest.mark.parametrize("name", ["nvdb_rocks.nvdb", "vdb_wdas_cloud_sixteenth.vdb"])
def test_real_grids_are_the_same_in_both_formats(tmp_path, name):
    is_nvdb = name.endswith(".nvdb")
    other = convert(DATA / name, tmp_path / ("a.vdb" if is_nvdb else "a.nvdb"))
    assert_same(*((other, DATA / name) if is_nvdb else (DATA / name, other)))


@pytest.mark.shared
@pytest.mark.skipif(not DATA.is_dir(), reason="no real volumes beside the checkout")
def test_real_level_set_is_as_listed():
    with open_source(DATA / "nvdb_rocks.nvdb", dataset="surface") as source:
        assert source.shape_zyx == (157, 63, 194)
        assert source.dtype == "float32"
        assert source.spacing_zyx == pytest.approx((0.2,) * 3)
        assert source.origin_xyz == pytest.approx((-19.2, -1.0, -15.6))
        assert source.background == pytest.approx(0.6)
        voxels = source.read(Box.of_shape(source.shape_zyx))
    assert (np.abs(voxels) < source.background).sum() == 308_828


@pytest.mark.parametrize(
    ("kind", "dtype", "nc", "names"),
    [
        ("Vec3f", "float32", 3, ["x", "y", "z"]),
        ("RGBA8", "uint8", 4, ["red", "green", "blue", "alpha"]),
    ],
)
def test_components_are_channels(write, kind, dtype, nc, names):
    voxels = np.random.default_rng(5).integers(0, 255, (5, 9, 12, nc)).astype(dtype)
    with open_source(write(file_bytes(grid_bytes(voxels, (-2, 3, 4), kind)))) as source:
        assert [channel.name for channel in source.channels] == names
        box = Box((1, 2, 3), (5, 9, 11))
        expected = np.moveaxis(voxels, -1, 0)
        np.testing.assert_array_equal(source.read_channels(box), expected[:, *box.slices])
        for c in range(nc):
            np.testing.assert_array_equal(source.read(box, 0, c), expected[c][box.slices])


def test_tiles_and_space_between_are_known_without_reading(write):
    one = np.ones((1, 1, 1300), np.float32)
    tiles = {(8, 8, 0): 5.0, (16, 8, 0): 5.0, (16, 16, 0): 6.0}
    grid = bytearray(grid_bytes(one, background=-1, tiles=tiles))
    struct.pack_into("<6i", grid, 672 + 64, 0, 0, 0, 1299, 2999, 2999)
    with open_source(write(file_bytes(bytes(grid)))) as source:
        assert source.shape_zyx == (3000, 3000, 1300)
        assert source.background == -1
        assert source.constant(Box((100, 200, 0), (3000, 3000, 1300))) == -1
        assert source.constant(Box((0, 8, 9), (8, 16, 24))) == 5
        assert source.constant(Box((0, 8, 9), (8, 17, 24))) is None
        assert source.constant(Box((0, 0, 0), (1, 1, 1))) is None
        voxels = source.read(Box((0, 0, 0), (9, 30, 40)))
    expected = np.full((9, 30, 40), -1, np.float32)
    expected[:8, 8:16, 8:24], expected[:8, 16:24, 16:24], expected[0, 0] = 5, 6, 1
    np.testing.assert_array_equal(voxels[:, 8:], expected[:, 8:])
    np.testing.assert_array_equal(voxels[0, 0], expected[0, 0])


def test_one_of_several_grids_is_chosen_by_name(write):
    grids = [grid_bytes(VOXELS + n, name=name) for n, name in enumerate(["a", "b", "b"])]
    path = write(file_bytes(*grids[:2], codec="zip") + file_bytes(grids[2]))
    with pytest.raises(InvalidInputError, match=r"several grids; .*: a \(float\), b\[0\] \(float"):
        open_source(path)
    with pytest.raises(InvalidInputError, match="no grid 'c'"):
        open_source(path, dataset="c")
    for n, name in enumerate(["a", "b[0]", "b[1]"]):
        with open_source(path, dataset=name) as source:
            voxels = source.read(Box.of_shape(source.shape_zyx))
        np.testing.assert_array_equal(voxels, VOXELS + n)
    with pytest.raises(InvalidInputError, match="--axes"):
        open_source(path, axes="zyx")


def patched(*patches: tuple[int, str, int]) -> bytes:
    """A grid with numbers replaced, each given by where it is, its kind and itself."""
    grid = bytearray(grid_bytes(VOXELS, (3, 9, 5)))
    for at, kind, number in patches:
        struct.pack_into(f"<{kind}", grid, at, number)
    return bytes(grid)


ROOT = 672 + 64
TILE = ROOT + 64
UPPER = TILE + 32
LOWER = UPPER + 8256 + 8 * 32**3


@pytest.mark.parametrize(
    ("patch", "message"),
    [
        ((0, "Q", 7), "begins with"),
        ((672 + 24, "Q", 1 << 62), "outside"),
        ((672 + 24, "Q", (1 << 64) - 1), "outside"),
        ((ROOT, "i", -5000), "active voxels"),
        ((ROOT + 12, "i", 5000), "active voxels"),
        ((ROOT + 12, "i", 2), "no active voxel"),
        ((ROOT + 24, "I", 0xFFFFFFFF), "4294967295 tiles"),
        ((ROOT + 24, "I", 200_000), "outside"),
        ((ROOT + 24, "I", 2), "damaged"),
        ((TILE + 8, "q", 1 << 62), "outside"),
        ((TILE + 8, "q", -(1 << 63)), "outside"),
        ((TILE + 8, "q", -ROOT - 1), "outside"),
        ((UPPER + 8256, "q", 1 << 62), "outside"),
        ((UPPER + 8256, "q", -(1 << 63)), "outside"),
        ((UPPER + 32 + 4096, "Q", 3), r"outside|upon each other"),
        ((LOWER + 1088 + 8 * 16, "q", 1 << 62), "outside"),
        ((LOWER + 1088 + 8 * 16, "q", -(1 << 63)), "outside"),
    ],
)
def test_number_that_contradicts_the_grid_is_refused(write, patch, message):
    path = write(file_bytes(patched(patch)))
    with pytest.raises(OctobrickError, match=message), open_source(path) as source:
        source.read(Box.of_shape(source.shape_zyx))


def test_grid_that_is_of_other_values_than_the_file_says_is_refused(write):
    content = bytearray(file_bytes(patched()))
    struct.pack_into("<I", content, 16 + 176 + len("density\0") + 636, 2)
    with pytest.raises(SourceError, match="its values are double, not float"):
        open_source(write(content))


PLACES = st.one_of(
    st.integers(0, 672 + 64 + 128),
    st.integers(UPPER + 32, UPPER + 60),
    st.sampled_from([*range(UPPER + 4128, UPPER + 4132), *range(UPPER + 8256, UPPER + 8264)]),
    st.sampled_from([*range(LOWER + 544, LOWER + 560), *range(LOWER + 1216, LOWER + 1224)]),
)


@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(flips=st.lists(st.tuples(PLACES, st.integers(0, 255)), min_size=1, max_size=3))
@example(flips=[(ROOT + 15, 127), (ROOT + 19, 127), (ROOT + 23, 127)])
def test_damaged_nodes_are_an_octobrick_error_or_other_voxels(write, flips):
    path = write(file_bytes(patched(*((at, "B", byte) for at, byte in flips))))
    with contextlib.suppress(OctobrickError), open_source(path) as source:
        box = Box.of_shape(tuple(min(size, 64) for size in source.shape_zyx))
        assert source.read(box).shape == box.shape_zyx
        source.constant(Box.of_shape(source.shape_zyx))


@settings(
    max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    codec=st.sampled_from(["zip", "blosc"]),
    at=st.integers(0, 5000),
    byte=st.integers(0, 255),
)
def test_damaged_packed_data_are_an_octobrick_error_or_other_voxels(write, codec, at, byte):
    content = bytearray(file_bytes(patched(), codec=codec))
    content[min(200 + at, len(content) - 1)] = byte
    with contextlib.suppress(OctobrickError), open_source(write(content)) as source:
        source.read(Box.of_shape(tuple(min(size, 64) for size in source.shape_zyx)))


def test_packed_data_that_are_not_as_long_as_said_are_refused(write):
    grid = patched()
    for codec in ("zip", "blosc"):
        content = bytearray(file_bytes(grid, codec=codec))
        for nbytes in (len(grid) - 32, len(grid) + 32):
            struct.pack_into("<Q", content, 16, nbytes)
            with pytest.raises(SourceError, match=r"unpack|packed part"):
                open_source(write(content))
        struct.pack_into("<Q", content, 16, 1 << 60)
        with pytest.raises(SourceError, match="is said to have"):
            open_source(write(content))


def test_file_that_is_cut_short_names_both_ends(write):
    whole = file_bytes(patched())
    with pytest.raises(TruncatedSourceError, match=rf"after {len(whole) - 20} .* {len(whole)}"):
        open_source(write(whole[:-20]))


@pytest.mark.parametrize(("kind", "name"), [(19, "Index"), (18, "Vec4d"), (99, "of kind 99")])
def test_values_that_are_not_read_are_refused_by_name(write, kind, name):
    with pytest.raises(UnsupportedSourceError, match=f"'density' are {name}; those read are float"):
        open_source(write(file_bytes(patched((636, "I", kind)))))


def test_points_are_refused(write):
    with pytest.raises(UnsupportedSourceError, match="points"):
        open_source(write(file_bytes(patched((632, "I", 5)))))


@pytest.mark.parametrize("where", ["file", "grid"])
def test_another_major_version_is_refused(write, where):
    content = bytearray(file_bytes(patched((16, "I", 31 << 21)) if where == "grid" else patched()))
    if where == "file":
        struct.pack_into("<I", content, 8, 31 << 21)
    with pytest.raises(UnsupportedSourceError, match=r"NanoVDB 31\.0; 32 is read"):
        open_source(write(content))


def test_missing_numcodecs_is_named(write, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "numcodecs", None)
    with pytest.raises(ResourceError, match="numcodecs"):
        open_source(write(file_bytes(patched(), codec="blosc")))


def test_full_disk_while_unpacking_is_told(write, monkeypatch):
    path = write(file_bytes(patched(), codec="zip"))
    full = Path("/dev/full").open("wb", buffering=0)  # noqa: SIM115 - closed by the source
    monkeypatch.setattr("tempfile.TemporaryFile", lambda **_: full)
    with pytest.raises(ResourceError, match="TMPDIR"):
        open_source(path)


def test_turned_map_is_the_direction(write):
    patches = [(296 + 88 + 8 * n, "d", v) for n, v in enumerate([0, -2, 0, 3, 0, 0, 0, 0, 1])]
    moved = [(296 + 232 + 8 * n, "d", v) for n, v in enumerate([10, 20, 30])]
    with open_source(write(file_bytes(patched(*patches, *moved)))) as source:
        assert source.spacing_zyx == (1, 2, 3)
        assert source.direction == ((0, -1, 0), (1, 0, 0), (0, 0, 1))
        assert source.origin_xyz == (10 - 2 * 9, 20 + 3 * 3, 30 + 5)
