"""octobrick's service: volumes, bricks and pictures over HTTP, and the command line.

The public names are loaded when first used, so that the command line works, and starts quickly,
without the packages of the ``server`` extra.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from octobrick.server.app import create_app as create_app
    from octobrick.server.settings import Settings as Settings

__all__ = ["Settings", "create_app"]


def __getattr__(name: str) -> object:
    if name == "create_app":
        from octobrick.server.app import create_app

        return create_app
    if name == "Settings":
        from octobrick.server.settings import Settings

        return Settings
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
