"""Addresses of a volume's bricks, and requests that know where to read them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from octobrick.store.box import Zyx

Kind = Literal["voxels", "decoded", "directions"]


@dataclass(frozen=True, slots=True)
class BrickAddress:
    """What never changes its bytes.

    Attributes:
        revision: of the volume.
        kind: the bytes that the store has of voxels, raw voxels that the source decodes, or codes
            of gradient directions.
        level: of the pyramid.
        t: time step.
        c: channel.
        zyx: place in the level's grid of bricks.
    """

    revision: str
    kind: Kind
    level: int
    t: int
    c: int
    zyx: Zyx


@dataclass(frozen=True, slots=True)
class BrickRequest:
    """An address, and what to read it from; equal to others of the same address.

    Attributes:
        address: of the brick.
        source: has ``brick_code``, ``brick`` or ``code``, by the address's kind.
    """

    address: BrickAddress
    source: Any = field(compare=False, repr=False)

    def read(self) -> bytes | None:
        """The brick's bytes, from the source; None for an absent one.

        Raises whatever the source does. May be called from any thread, if the source may.
        """
        at = self.address
        if at.kind == "voxels":
            code: bytes | None = self.source.brick_code(at.level, at.zyx, at.t, at.c)
            return code
        if at.kind == "directions":
            directions: bytes | None = self.source.code(at.level, at.zyx, at.t, at.c)
            return directions
        voxels = self.source.brick(at.level, at.zyx, at.t, at.c)
        return np.ascontiguousarray(voxels, voxels.dtype.newbyteorder("<")).tobytes()
