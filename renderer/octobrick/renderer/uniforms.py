"""Sets the uniforms of a program by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from octobrick.renderer.errors import ShaderError

if TYPE_CHECKING:
    import moderngl

WORKGROUP_XY = 8
"""local_size_x and local_size_y of every pass over voxels or cells; local_size_z is 1."""


def set_uniforms(program: moderngl.ComputeShader, values: Mapping[str, Any]) -> None:
    """Set uniforms to numbers or sequences; samplers to texture units.

    Raises:
        ShaderError: the program has no such uniform: a name was changed in one place only.
    """
    for name, value in values.items():
        if name not in program:
            raise ShaderError(
                f"the program has no uniform {name}; it has {sorted(program)}", uniform=name
            )
        member: Any = program[name]
        member.value = value if isinstance(value, (int, float)) else tuple(value)


def run_over(program: moderngl.ComputeShader, size_xyz: tuple[int, int, int]) -> None:
    """Run a program with at least one invocation for every element of a box."""
    x, y, z = size_xyz
    program.run(-(-x // WORKGROUP_XY), -(-y // WORKGROUP_XY), z)
