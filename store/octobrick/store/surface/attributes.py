"""What a volume says of the surface around which alone it holds voxels; checked when read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import VolumeFormatError
from octobrick.store.surface.placement import Placement

_COUNT_MAX = 2**63
_NAME_MAX = 4096


@dataclass(frozen=True, slots=True)
class SurfaceAttributes:
    """The surface of a solid texture.

    Attributes:
        name: the file it came from.
        digest: as `Mesh.digest` gives it.
        nvertices: how many it has.
        nfaces: likewise.
        placement: where it lies in the volume.
        ncells: cells of 4³ voxels that are kept, of each level.
    """

    name: str
    digest: str
    nvertices: int
    nfaces: int
    placement: Placement
    ncells: tuple[int, ...]

    def to_json(self) -> dict[str, Any]:
        """As it stands in the attributes."""
        return {
            "name": self.name,
            "digest": self.digest,
            "vertices": self.nvertices,
            "faces": self.nfaces,
            "placement": self.placement.to_json(),
            "cells": list(self.ncells),
        }

    @classmethod
    def from_fields(cls, fields: dict[str, Any], where: str) -> SurfaceAttributes | None:
        """Of all attributes of a volume; None where it has no surface.

        Raises:
            VolumeFormatError: it makes no sense.
        """
        value = fields.get("surface")
        if value is None:
            return None
        match value:
            case {
                "name": str(name),
                "digest": str(digest),
                "vertices": int(nvertices),
                "faces": int(nfaces),
                "placement": list(placement),
                "cells": list(ncells),
            } if (
                len(name) <= _NAME_MAX
                and len(digest) <= _NAME_MAX
                and all(
                    type(n) is int and 0 <= n < _COUNT_MAX for n in (nvertices, nfaces, *ncells)
                )
            ):
                try:
                    at = Placement.from_json(placement)
                except InvalidInputError as error:
                    raise _wrong(where, error.message) from error
                return cls(name, digest, nvertices, nfaces, at, tuple(ncells))
        raise _wrong(where, "it needs name, digest, vertices, faces, placement and cells")


def _wrong(where: str, what: str) -> VolumeFormatError:
    return VolumeFormatError(
        f"{where}: octobrick.surface makes no sense: {what}; ingest the volume again",
        field="surface",
    )
