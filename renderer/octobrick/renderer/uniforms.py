"""Sets the uniforms of a program by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from octobrick.renderer.errors import ShaderError

if TYPE_CHECKING:
    import moderngl

WORKGROUP_XY = 8
"""local_size_x and local_size_y of every pass over voxels or cells; local_size_z is 1."""


def set_uniforms(
    program: moderngl.ComputeShader | moderngl.Program,
    values: Mapping[str, Any],
    *,
    some_unused: bool = False,
) -> None:
    """Set uniforms to numbers or sequences, samplers to texture units, arrays to NumPy arrays.

    Args:
        program: with the uniforms.
        values: by name. A NumPy array sets an array of vectors, or of int32, or of float32.
        some_unused: for programs whose variants do not use all of them.

    Raises:
        ShaderError: the program has no such uniform: a name was changed in one place only.
    """
    for name, value in values.items():
        if name not in program:
            if some_unused:
                continue
            raise ShaderError(
                f"the program has no uniform {name}; it has {sorted(program)}", uniform=name
            )
        member: Any = program[name]
        if isinstance(value, np.ndarray) and (value.ndim > 1 or member.dimension == 1):
            member.write(_as_declared(value, member.array_length).tobytes())
        else:
            member.value = value if isinstance(value, (int, float)) else tuple(value)


def run_over(program: moderngl.ComputeShader, size_xyz: tuple[int, int, int]) -> None:
    """Run a program with at least one invocation for every element of a box."""
    x, y, z = size_xyz
    program.run(-(-x // WORKGROUP_XY), -(-y // WORKGROUP_XY), z)


def _as_declared(values: np.ndarray[Any, Any], count: int) -> np.ndarray[Any, Any]:
    """Float32 or int32 rows, as many as the program has room for; missing ones are 0.

    That may be fewer than declared: compilers cut arrays down to what is used.
    """
    kind = np.int32 if values.dtype.kind in "iu" else np.float32
    rows = np.zeros((count, *values.shape[1:]), kind)
    rows[: len(values)] = values[:count]
    return rows
