"""Optional packages, imported when a format needs them."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from octobrick.codec.errors import ResourceError


def require_package(name: str, path: Path) -> Any:
    """The module of an optional package.

    Raises:
        ResourceError: it is not installed; naming the extra that installs it.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise ResourceError(
            f"{path.name}: writing this format takes the package {name}; "
            "install it with: pip install 'octobrick[formats]'",
            package=name,
        ) from error
