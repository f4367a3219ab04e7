"""Where a surface lies in a volume: an affine map from the mesh's space to the world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.store.surface.mesh import Mesh, Vectors, unit_vectors

UpAxis = Literal["x", "y", "z"]
# Which of the mesh's axes become the world's x, y and z. Cyclic, so that none is mirrored.
_TURNS = {"z": (0, 1, 2), "y": (2, 0, 1), "x": (1, 2, 0)}


@dataclass(frozen=True, slots=True)
class Placement:
    """A map of the mesh's space to the world: world = matrix · (x, y, z, 1).

    Args:
        matrix: three rows of four numbers, finite, of which the left three columns span space.

    Raises:
        InvalidInputError: anything else.
    """

    matrix: tuple[tuple[float, float, float, float], ...]

    def __post_init__(self) -> None:
        try:
            matrix = np.array(self.matrix, np.float64)
        except (TypeError, ValueError):
            matrix = np.zeros(0)
        if matrix.shape != (3, 4) or not np.isfinite(matrix).all() or not _spans(matrix[:, :3]):
            raise InvalidInputError(
                f"placement {self.matrix!r:.200} must be three rows of four finite numbers, of "
                "which the left three columns span space"
            )
        rows = tuple(tuple(row) for row in matrix.tolist())
        object.__setattr__(self, "matrix", rows)

    @classmethod
    def of_numbers(cls, numbers: Sequence[float]) -> Placement:
        """Of twelve numbers, row by row."""
        if len(numbers) != 12:
            raise InvalidInputError(f"placement: {len(numbers)} numbers; give three rows of four")
        a, b, c, d, e, f, g, h, i, j, k, m = numbers
        return cls(((a, b, c, d), (e, f, g, h), (i, j, k, m)))

    @classmethod
    def fitted(
        cls, mesh: Mesh, low_world_xyz: Vectors, high_world_xyz: Vectors, up: UpAxis = "z"
    ) -> Placement:
        """The mesh in the middle of a box, as large as fits without changing its shape.

        Args:
            mesh: what is placed.
            low_world_xyz: lowest corner of the box.
            high_world_xyz: highest corner.
            up: the mesh's axis that becomes the world's z.

        Raises:
            InvalidInputError: all vertices are at one place, or there is no such axis.
        """
        if up not in _TURNS:
            raise InvalidInputError(f"up {up!r:.20}: must be one of {', '.join(sorted(_TURNS))}")
        turn = np.eye(3)[list(_TURNS[up])]
        low, high = mesh.bounds_xyz
        extent, room = turn @ (high - low), high_world_xyz - low_world_xyz
        if not extent.any():
            raise InvalidInputError(f"{mesh.name}: all vertices are at one place; nothing to fit")
        scale = float(np.min(room[extent > 0] / extent[extent > 0]))
        middle = (low_world_xyz + high_world_xyz) / 2
        offset = middle - scale * (turn @ ((low + high) / 2))
        return cls(tuple(map(tuple, np.column_stack([scale * turn, offset]).tolist())))

    @property
    def linear(self) -> NDArray[np.float64]:
        """What is done to directions, 3×3."""
        return np.array(self.matrix)[:, :3]

    def places(self, points_xyz: Vectors) -> Vectors:
        """Where points (n, 3) of the mesh lie in the world."""
        return np.asarray(points_xyz @ self.linear.T + np.array(self.matrix)[:, 3])

    def normals(self, normals_xyz: Vectors) -> Vectors:
        """Unit normals (n, 3) in the world; 0 stays 0."""
        # Across all directions of the surface, which the inverse transpose keeps.
        return unit_vectors(normals_xyz @ np.linalg.inv(self.linear))

    def to_json(self) -> list[list[float]]:
        """Three rows of four numbers."""
        return [list(row) for row in self.matrix]

    @classmethod
    def from_json(cls, value: Any) -> Placement:
        """What `to_json` gave.

        Raises:
            InvalidInputError: it is something else.
        """
        if not isinstance(value, list) or any(not isinstance(row, list) for row in value):
            raise InvalidInputError(f"placement {value!r:.80} must be three rows of four numbers")
        return cls(tuple(map(tuple, value)))


def _spans(linear: NDArray[np.float64]) -> bool:
    largest = float(np.abs(linear).max())
    return (
        largest > 0
        and abs(float(np.linalg.det(linear / largest))) > 1e-9
        and (math.isfinite(1 / largest))
    )
