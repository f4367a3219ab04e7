"""Puts a shader together from files: includes, and values for ${NAMES}.

Substitution is loud: a name without a value, a value without a name, or a file that is not there
raises, instead of a shader that quietly does something else.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources
from typing import Any

from octobrick.renderer.errors import ShaderError

VERSION_LINE = "#version 450 core\n"
"""OpenGL 4.5: the newest that Mesa's software renderer offers; compute, images and doubles."""

_INCLUDE = re.compile(r'^#include "([a-z0-9_.]+)"\n', re.MULTILINE)
_NAME = re.compile(r"\$\{([A-Z0-9_]+)\}")

Values = Mapping[str, str | int | bool]


def shader_source(name: str, values: Values, *, folder: Any = None) -> str:
    """The complete text of a shader.

    Args:
        name: its file, such as "raycast.comp.glsl".
        values: what replaces each ${NAME}; exactly the names that the text uses. A bool becomes
            1 or 0.
        folder: where the files are; the package's own by default.

    Raises:
        ShaderError: a file, a value or a use of a value is missing, or a file includes itself.
    """
    folder = resources.files("octobrick.renderer") / "shaders" if folder is None else folder
    text = _expand(folder, name, ())
    used = set(_NAME.findall(text))
    if used != set(values):
        missing, unused = sorted(used - set(values)), sorted(set(values) - used)
        raise ShaderError(
            f"shader {name}: no value for {missing}, no use for {unused}; the values given must be "
            "exactly those that the shader names",
            shader=name,
            missing=missing,
            unused=unused,
        )
    return VERSION_LINE + _NAME.sub(lambda match: _text(values[match.group(1)]), text)


def numbered(source: str) -> str:
    """The text with line numbers as compilers count them."""
    return "\n".join(f"{i:4d}  {line}" for i, line in enumerate(source.splitlines(), 1))


def _expand(folder: Any, name: str, within: tuple[str, ...]) -> str:
    if name in within:
        raise ShaderError(f"shader {name} includes itself through {list(within)}", shader=name)
    try:
        text: str = (folder / name).read_text("utf-8")
    except FileNotFoundError as error:
        by = f", included by {within[-1]}" if within else ""
        raise ShaderError(f"there is no shader file {name}{by}", shader=name) from error
    return _INCLUDE.sub(lambda match: _expand(folder, match.group(1), (*within, name)), text)


def _text(value: str | int | bool) -> str:
    return str(int(value)) if isinstance(value, bool) else str(value)
