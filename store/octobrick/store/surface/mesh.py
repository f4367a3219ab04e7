"""A surface of triangles: places, faces and normals, checked once and never changed."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from octobrick.codec.errors import InvalidInputError

Vectors = NDArray[np.float64]
Faces = NDArray[np.int32]

VERTICES_MAX = 50_000_000
FACES_MAX = 100_000_000
# Squares of differences of places, and products of four of them, stay far inside of float64.
_PLACE_MAX = 1e30


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles. Degenerate ones are kept: they cover what a line or a point does.

    Args:
        vertices_xyz: (n, 3), finite, in the mesh's own space.
        faces: (m, 3), indices of vertices, at least one face.
        normals_xyz: (n, 3), of each vertex, of any length; where there are none, they are made of
            the faces around it, weighted by their areas.
        name: for people.

    Raises:
        InvalidInputError: no face, an index without a vertex, or a number that is not finite.
    """

    vertices_xyz: Vectors
    faces: Faces
    normals_xyz: Vectors = field(default_factory=lambda: np.empty((0, 3)))
    name: str = "mesh"

    def __post_init__(self) -> None:
        vertices = _places("vertices", self.vertices_xyz, self.name)
        faces = _faces(self.faces, len(vertices), self.name)
        if len(self.normals_xyz) == 0:
            normals = area_weighted_normals(vertices, faces)
        else:
            normals = _places("normals", self.normals_xyz, self.name)
            if normals.shape != vertices.shape:
                raise InvalidInputError(
                    f"{self.name}: {len(normals)} normals for {len(vertices)} vertices; give one "
                    "for each, or none"
                )
            normals = unit_vectors(normals)
        for name, array in (("vertices_xyz", vertices), ("faces", faces), ("normals_xyz", normals)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def bounds_xyz(self) -> tuple[Vectors, Vectors]:
        """Lowest and highest corner of the box around all vertices that faces use."""
        used = self.vertices_xyz[np.unique(self.faces)]
        return used.min(axis=0), used.max(axis=0)

    @cached_property
    def digest(self) -> str:
        """Of places and faces (blake2b, 16 bytes, hexadecimal): names the surface."""
        content = hashlib.blake2b(digest_size=16)
        content.update(self.vertices_xyz.astype("<f8").tobytes())
        content.update(self.faces.astype("<i4").tobytes())
        return content.hexdigest()

    def __repr__(self) -> str:
        return f"<Mesh {self.name!r}: {len(self.vertices_xyz)} vertices, {len(self.faces)} faces>"


def area_weighted_normals(vertices_xyz: Vectors, faces: Faces) -> Vectors:
    """Unit normals of vertices: the sum of their faces', each as long as its area; 0 of none."""
    low = vertices_xyz.min(axis=0)
    extent = float((vertices_xyz.max(axis=0) - low).max()) or 1.0
    scaled = (vertices_xyz - low) / extent  # so that no product leaves float64's range
    corners = scaled[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.empty_like(vertices_xyz)
    for axis in range(3):
        weights = np.repeat(across[:, axis], 3)
        sums[:, axis] = np.bincount(faces.ravel(), weights, minlength=len(vertices_xyz))
    return unit_vectors(sums)


def unit_vectors(vectors: Vectors) -> Vectors:
    """The directions of vectors (n, 3); 0 where there is none."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0)
    lengths = np.linalg.norm(scaled, axis=1, keepdims=True)
    units: Vectors = np.divide(scaled, lengths, out=np.zeros_like(vectors), where=lengths > 0)
    return units


def _places(what: str, values: ArrayLike, name: str) -> Vectors:
    try:
        array = np.array(values, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: {what} are no numbers ({error})") from error
    if array.ndim != 2 or array.shape[1] != 3 or len(array) > VERTICES_MAX:
        raise InvalidInputError(
            f"{name}: {what} have shape {array.shape}; give (n, 3), n up to {VERTICES_MAX}"
        )
    sound = np.isfinite(array).all(axis=1) & (np.abs(array) <= _PLACE_MAX).all(axis=1)
    if not sound.all():
        at = int(np.argmin(sound))
        raise InvalidInputError(
            f"{name}: {'vertex' if what == 'vertices' else 'normal'} {at} is "
            f"{tuple(array[at].tolist())}; places must be finite, up to {_PLACE_MAX:g}",
            index=at,
        )
    return array


def _faces(values: Any, nvertices: int, name: str) -> Faces:
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3 or not 1 <= len(array) <= FACES_MAX:
        raise InvalidInputError(
            f"{name}: faces have shape {array.shape}; give (m, 3), m from 1 to {FACES_MAX}"
        )
    if array.dtype.kind not in "iu":
        raise InvalidInputError(f"{name}: faces are of {array.dtype}; give indices of vertices")
    low, high = int(array.min()), int(array.max())
    if low < 0 or high >= nvertices:
        at = int(np.argmax(((array < 0) | (array >= nvertices)).any(axis=1)))
        raise InvalidInputError(
            f"{name}: face {at} has the vertices {array[at].tolist()}, but there are {nvertices}, "
            "from 0 on; export the mesh again",
            index=at,
            vertices=nvertices,
        )
    return np.array(array, dtype=np.int32, order="C")
