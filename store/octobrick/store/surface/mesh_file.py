"""Reads surfaces of triangles from files that people have: PLY and OBJ, also with gzip.

trimesh does the parsing. What a file announces is checked before, what came out of it after; files
that a mesh names, of materials and textures, are never opened.
"""

from __future__ import annotations

import gzip
import io
import os
import re
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.store.errors import SourceError, SourceNotFoundError, UnsupportedSourceError
from octobrick.store.surface.mesh import FACES_MAX, VERTICES_MAX, Mesh

MESH_NBYTES_MAX = 2**30
"""Of a file, unpacked: its text takes a parser several times as much memory."""
_PLY_HEADER_NBYTES_MAX = 64 * 1024
_PIECE_NBYTES = 1 << 20
_KINDS = (".ply", ".obj")
# The parser would take it for the last vertex.
_OBJ_INDEX_0 = re.compile(rb"^f[^\n]*[ \t]0+(?=[/ \t\r\n]|\Z)", re.MULTILINE)


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
    """The surface in a PLY (ASCII or binary) or OBJ file, perhaps gzipped (``.ply.gz``).

    Polygons become triangles. Normals are the file's, or are made of the faces around a vertex.

    Raises:
        SourceNotFoundError: there is no such file.
        UnsupportedSourceError: another suffix.
        SourceError: the file is damaged, cut short, too large, or its indices or numbers make no
            sense.
        ResourceError: trimesh is not installed; the message names the extra.
    """
    file = Path(path)
    zipped = file.suffix.lower() == ".gz"
    kind = Path(file.stem if zipped else file.name).suffix.lower()
    if kind not in _KINDS:
        raise UnsupportedSourceError(
            f"{file}: a mesh is read from {', '.join(_KINDS)}, perhaps with .gz; convert it",
            path=str(file),
        )
    content = _content(file, zipped=zipped)
    announced = _ply_counts(content, file) if kind == ".ply" else {}
    if kind == ".obj" and (wrong := _OBJ_INDEX_0.search(content)):
        raise _damaged(file, f"the face at byte {wrong.start()} has an index 0; they begin at 1")
    arrays = _parsed(content, kind[1:], file)
    _require_all(arrays, announced, file)
    try:
        return Mesh(**arrays, name=file.name)
    except InvalidInputError as error:
        raise SourceError(error.message, path=str(file), **error.facts) from error


def _content(file: Path, *, zipped: bool) -> bytes:
    try:
        with file.open("rb") as raw:
            stream: IO[bytes] = gzip.GzipFile(fileobj=raw) if zipped else raw  # type: ignore[assignment]
            return _bounded(stream, file)
    except FileNotFoundError as error:
        raise SourceNotFoundError(f"{file}: no such mesh file", path=str(file)) from error
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise _damaged(file, f"its gzip stream is damaged or cut short ({error})") from error
    except OSError as error:
        raise SourceNotFoundError(
            f"{file}: cannot be read ({error.strerror or error})", path=str(file)
        ) from error


def _bounded(stream: IO[bytes], file: Path) -> bytes:
    pieces, nbytes = [], 0
    while piece := stream.read(_PIECE_NBYTES):
        nbytes += len(piece)
        if nbytes > MESH_NBYTES_MAX:
            raise _damaged(file, f"it is larger than {MESH_NBYTES_MAX} bytes, the most for a mesh")
        pieces.append(piece)
    return b"".join(pieces)


def _ply_counts(content: bytes, file: Path) -> dict[str, int]:
    """How many elements of each kind a header announces, if the file can hold as many."""
    header, end, _ = content[:_PLY_HEADER_NBYTES_MAX].partition(b"end_header")
    if not header.startswith(b"ply") or not end:
        raise _damaged(file, "it has no PLY header")
    limits, counts = {"vertex": VERTICES_MAX, "face": FACES_MAX}, {}
    for name, text in re.findall(rb"^element[ \t]+(\S+)[ \t]+(\S+)", header, re.MULTILINE):
        element, number = (part.decode("ascii", "replace")[:40] for part in (name, text))
        count = int(text) if text.isdigit() and len(text) < 19 else -1
        # Whatever an element is, it takes a byte or more.
        if not 0 <= count <= min(limits.get(element, VERTICES_MAX), len(content)):
            raise _damaged(
                file, f"its header announces {number} of {element}, in {len(content)} bytes"
            )
        counts[element] = count
    return counts


def _require_all(arrays: dict[str, Any], announced: dict[str, int], file: Path) -> None:
    """Refuse a file that ends early, which the parser may take for a smaller one."""
    for element, key in (("vertex", "vertices_xyz"), ("face", "faces")):
        have, want = len(arrays[key]), announced.get(element, 0)
        if have < want:
            raise _damaged(file, f"it holds {have} of {element}, its header announces {want}")


def _parsed(content: bytes, kind: str, file: Path) -> dict[str, Any]:
    """Vertices, faces and, where the file has them, normals."""
    try:
        from trimesh.exchange import obj, ply
    except ImportError as error:
        raise ResourceError(
            "reading meshes needs trimesh, which is not installed: pip install 'octobrick[mesh]'",
            package="trimesh",
        ) from error
    load: Any = {"ply": ply.load_ply, "obj": obj.load_obj}[kind]
    try:
        # No resolver: nothing beside these bytes is ever opened.
        parsed = load(
            io.BytesIO(content),
            resolver=None,
            skip_materials=True,
            fix_texture=False,
            maintain_order=True,
        )
        arrays = _joined(list(parsed.get("geometry", {"": parsed}).values()))
    except Exception as error:  # a parser of text raises what it pleases on nonsense
        raise _damaged(file, f"it cannot be parsed ({type(error).__name__}: {error!s:.200})") from (
            error
        )
    if arrays["faces"].size == 0:
        raise _damaged(file, "it has no faces")
    return arrays


def _joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """One surface of the groups of a file; with normals, where all of them have sound ones."""
    vertices, faces, normals, nvertices = [], [], [], 0
    for part in parts:
        own = np.asarray(part["vertices"], np.float64).reshape(-1, 3)
        vertices.append(own)
        faces.append(_triangles(part.get("faces")) + nvertices)
        normals.append(_normals(part.get("vertex_normals"), own))
        nvertices += len(own)
    sound = [own for own in normals if own is not None]
    joined = {"vertices_xyz": np.concatenate(vertices), "faces": np.concatenate(faces)}
    if len(sound) == len(parts):
        joined["normals_xyz"] = np.concatenate(sound)
    return joined


def _triangles(faces: Any) -> NDArray[np.int64]:
    """Faces of three indices; of more, a fan."""
    array = np.asarray([] if faces is None else faces)
    if array.size == 0:
        return np.zeros((0, 3), np.int64)
    if array.ndim != 2 or array.shape[1] < 3 or array.dtype.kind not in "iu":
        raise ValueError(f"faces of shape {array.shape}, {array.dtype}")
    fans = [array[:, [0, i, i + 1]] for i in range(1, array.shape[1] - 1)]
    return np.concatenate(fans).astype(np.int64)


def _normals(values: Any, vertices: NDArray[np.float64]) -> NDArray[np.float64] | None:
    if values is None or np.shape(values) != vertices.shape:
        return None
    normals = np.asarray(values, np.float64)
    return normals if np.isfinite(normals).all() and normals.any() else None


def _damaged(file: Path, what: str) -> SourceError:
    return SourceError(f"{file}: {what}; export the mesh again", path=str(file))
