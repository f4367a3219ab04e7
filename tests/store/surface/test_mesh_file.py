"""Meshes come out of files as they went in, and bad files are refused by name, soon."""

from __future__ import annotations

import contextlib
import gzip
import sys
from pathlib import Path

import numpy as np
import pytest

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store import Mesh, read_mesh
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError

CORNERS = "0 0 0\n2 0 0\n0 1 0\n0 0 3\n"
TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


def ply(corners: str, faces: str, nvertices: int | None = None, nfaces: int | None = None) -> str:
    """A PLY file in text; its counts are those of the lines unless told otherwise."""
    nvertices = corners.count("\n") if nvertices is None else nvertices
    nfaces = faces.count("\n") if nfaces is None else nfaces
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat ascii 1.0\nelement vertex {nvertices}\n{axes}element face {nfaces}\n"
        f"property list uchar int vertex_indices\nend_header\n{corners}{faces}"
    )


def binary_ply() -> bytes:
    head = ply("", "", 4, 4).replace("ascii", "binary_little_endian").encode()
    corners = np.fromstring(CORNERS, "<f4", sep=" ").tobytes()
    faces = b"".join(b"\x03" + np.array(face, "<i4").tobytes() for face in TETRAHEDRON)
    return head + corners + faces


FACES = "".join(f"3 {a} {b} {c}\n" for a, b, c in TETRAHEDRON)
OBJ = "".join(f"v {line}\n" for line in CORNERS.splitlines()) + "".join(
    f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in TETRAHEDRON
)
GOOD: dict[str, bytes] = {
    "text.ply": ply(CORNERS, FACES).encode(),
    "binary.ply": binary_ply(),
    "zipped.ply.gz": gzip.compress(binary_ply()),
    "mesh.obj": OBJ.encode(),
}


@pytest.mark.parametrize("name", GOOD)
def test_every_kind_of_file_gives_the_same_mesh(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(GOOD[name])
    mesh = read_mesh(tmp_path / name)
    np.testing.assert_array_equal(mesh.vertices_xyz, np.fromstring(CORNERS, sep=" ").reshape(4, 3))
    assert sorted(map(sorted, mesh.faces.tolist())) == sorted(map(sorted, TETRAHEDRON))
    assert (mesh.normals_xyz @ mesh.vertices_xyz.mean(axis=0)).min() < 0  # that of the origin


BAD: dict[str, tuple[str | bytes, str]] = {
    "short.ply": (ply(CORNERS, FACES, nfaces=5), "holds 4 of face, its header announces 5"),
    "cut.ply": (binary_ply()[:-3], "cannot be parsed"),
    "billion.ply": (ply(CORNERS, FACES, nfaces=10**9), "announces 1000000000 of face"),
    "endless.ply": (ply(CORNERS, FACES, nvertices=10**40), "announces 1000"),
    "beyond.ply": (ply(CORNERS, "3 0 1 4\n"), r"face 0 has the vertices \[0, 1, 4\]"),
    "negative.ply": (ply(CORNERS, "3 0 1 -1\n"), r"face 0 has the vertices \[0, 1, -1\]"),
    "nan.ply": (ply("0 0 0\n1 nan 0\n0 1 0\n", "3 0 1 2\n"), "vertex 1"),
    "inf.obj": ("v 0 0 0\nv 1 0 0\nv 0 inf 0\nf 1 2 3\n", "vertex 2"),
    "points.ply": (ply(CORNERS, ""), "no faces"),
    "empty.ply": ("", "no PLY header"),
    "beyond.obj": (OBJ + "f 1 2 9\n", "cannot be parsed"),
    "zero.obj": (OBJ + "f 0 1 2\n", "index 0"),
    "words.obj": ("v a b c\nf x y z\n", "cannot be parsed"),
    "cut.ply.gz": (gzip.compress(binary_ply())[:-20], "gzip"),
    "plain.ply.gz": (binary_ply(), "gzip"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_by_name_with_what_is_wrong(tmp_path: Path, name: str) -> None:
    content, message = BAD[name]
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SourceError, match=message) as caught:
        read_mesh(tmp_path / name)
    assert str(tmp_path / name) == caught.value.facts["path"]


def test_files_that_a_mesh_names_are_not_opened(tmp_path: Path) -> None:
    named = tmp_path / "named.mtl"
    named.write_text("newmtl a\nmap_Kd picture.png\n")
    named.chmod(0o000)
    (tmp_path / "mesh.obj").write_text(f"mtllib {named}\nusemtl a\n{OBJ}")
    assert len(read_mesh(tmp_path / "mesh.obj").faces) == 4


def test_a_gzip_bomb_is_refused_before_it_is_unpacked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("octobrick.store.surface.mesh_file.MESH_NBYTES_MAX", 2**20)
    with gzip.open(tmp_path / "bomb.ply.gz", "wb") as file:
        file.write(bytes(2**24))
    with pytest.raises(SourceError, match="larger than 1048576 bytes"):
        read_mesh(tmp_path / "bomb.ply.gz")


def test_no_file_and_no_kind_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(SourceNotFoundError, match=r"none\.ply"):
        read_mesh(tmp_path / "none.ply")
    with pytest.raises(UnsupportedSourceError, match=r"\.ply, \.obj"):
        read_mesh(tmp_path / "mesh.stl")


def test_without_trimesh_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mesh.obj").write_text(OBJ)
    monkeypatch.setitem(sys.modules, "trimesh.exchange", None)
    with pytest.raises(ResourceError, match=r"octobrick\[mesh\]"):
        read_mesh(tmp_path / "mesh.obj")


def test_polygons_become_triangles_and_normals_weigh_by_area(tmp_path: Path) -> None:
    square = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 10\n"
    (tmp_path / "fan.ply").write_text(ply(square, "4 0 1 2 3\n3 0 3 4\n"))
    mesh = read_mesh(tmp_path / "fan.ply")
    assert len(mesh.faces) == 3
    # One square of area 1 upwards, one triangle of area 5 along x.
    np.testing.assert_allclose(mesh.normals_xyz[3], np.array([5, 0, 1 / 2]) / np.hypot(5, 1 / 2))


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (np.zeros((3, 3)), np.zeros((0, 3), int)),
        (np.zeros((3, 2)), [[0, 1, 2]]),
        (np.zeros((3, 3)), [[0.0, 1.0, 2.0]]),
        (np.full((3, 3), 1e40), [[0, 1, 2]]),
    ],
)
def test_what_is_no_surface_is_refused(vertices: object, faces: object) -> None:
    with pytest.raises(InvalidInputError):
        Mesh(vertices, np.asarray(faces))  # type: ignore[arg-type]


def test_any_bytes_give_a_mesh_or_an_error_of_ours(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for round_ in range(60):
        name, content = list(GOOD.items())[round_ % 4]
        changed = bytearray(content)
        for at in rng.integers(0, len(changed), 3):
            changed[at] = rng.integers(256)
        (tmp_path / name).write_bytes(changed)
        with contextlib.suppress(SourceError):
            assert read_mesh(tmp_path / name).faces.max() < 10**6
