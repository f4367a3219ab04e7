"""What an address below a volume can name: a document, or a chunk that is made when asked for."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from octobrick.codec.errors import NotFoundError
from octobrick.store import LocalVolume

INDEX = r"(0|[1-9][0-9]{0,9})"
"""A number in a key, in the one way to write it; ten digits hold the longest side of a volume."""


@dataclass(frozen=True, slots=True)
class Document:
    """JSON that is short to make and small.

    Args:
        body: its bytes.
    """

    body: bytes

    @classmethod
    def of(cls, content: Any) -> Document:
        """The document of JSON-ready values, none of which is NaN or infinite."""
        text = json.dumps(content, separators=(",", ":"), allow_nan=False)
        return cls(text.encode())


@dataclass(frozen=True, slots=True)
class Chunk:
    """Voxels as one zstd frame.

    Args:
        name: tells it from all other chunks of the volume, whatever they are for.
        read: makes the frame; None where every voxel is the fill value. Blocks.
        is_stored: the frame lies on disk as it is, so there is nothing to keep in memory.
        is_content: the frame itself is the chunk; else it is the chunk under the content encoding
            ``zstd``, and clients that do not take that get what is inside.
    """

    name: tuple[str, ...]
    read: Callable[[LocalVolume], bytes | None]
    is_stored: bool
    is_content: bool


Resource = Document | Chunk


def nothing(key: str) -> NotFoundError:
    """The error for a key that names nothing; readers probe for files, so it is no surprise.

    A key may hold slashes, which do not leave the server: only its length is told.
    """
    return NotFoundError(
        "The volume has nothing at this key: readers look for more than there is",
        key_length=len(key),
    )
