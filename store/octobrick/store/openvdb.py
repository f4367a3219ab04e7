"""The optional extension over OpenVDB: imported where it is used, missed with a remedy."""

from __future__ import annotations

import importlib
from types import ModuleType

from octobrick.codec.errors import ResourceError


def import_vdb(purpose: str) -> ModuleType:
    """The extension, loaded on first use with the library's 57 MB.

    Args:
        purpose: what it is wanted for, to begin the message with.

    Raises:
        ResourceError: octobrick was built without OpenVDB, or the library has gone since.
    """
    try:
        return importlib.import_module("octobrick.store._vdb")
    except ImportError as error:
        raise ResourceError(
            f"{purpose} takes OpenVDB, without which octobrick was built ({error}); on Debian and "
            "Ubuntu: apt-get install libopenvdb-dev libboost-iostreams-dev, then install octobrick "
            "again (pip install --force-reinstall --no-deps octobrick)",
            package="libopenvdb-dev",
        ) from error
