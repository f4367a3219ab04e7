"""What the headers of a brick say: the fixed ones made once, the others looked up in tables."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from octobrick.server.catalog import OpenVolume
from octobrick.store.box import Zyx
from octobrick.store.brick_codec import codec_text

RawHeaders = list[tuple[bytes, bytes]]

_KEPT_HEADS = 4_096  # (brick, encoding) of a volume, at some 2 kB
_KEPT = 64  # (kind, level, t, c) of a volume: all of a pyramid; tables take some 10 bytes a brick


@dataclass(slots=True)
class BrickHead:
    """All headers of the answers for one brick in one encoding, but for the length.

    Each list is there twice: as ASGI takes headers, and as lines of text.
    """

    etag: str
    cached: RawHeaders
    absent: RawHeaders
    present: RawHeaders
    cached_lines: bytes = field(init=False)
    absent_lines: bytes = field(init=False)
    present_lines: bytes = field(init=False)

    def __post_init__(self) -> None:
        self.cached_lines = header_lines(self.cached)
        self.absent_lines = header_lines(self.absent)
        self.present_lines = header_lines(self.present)

    def keep(self, lent: OpenVolume, key: Hashable) -> None:
        """Keep it with the volume, for the next who asks."""
        if len(lent.heads) >= _KEPT_HEADS:
            lent.heads.clear()
        lent.heads[key] = self


def header_lines(headers: RawHeaders) -> bytes:
    """Headers as they stand in an HTTP/1.1 message."""
    return b"".join([b"%b: %b\r\n" % header for header in headers])


class BrickHeaders:
    """The headers of the bricks of one level, time step and channel that say what is known of them.

    Args:
        fixed: what is the same for all of them.
        ranges: least and greatest original voxel of each, (nz, ny, nx, 2); None for gradients.
        fidelity: largest error and RMSE of each, (nz, ny, nx, 2); None for gradients.
    """

    def __init__(
        self,
        fixed: dict[str, str],
        ranges: NDArray[Any] | None = None,
        fidelity: NDArray[np.float32] | None = None,
    ) -> None:
        self._fixed = [(name.encode(), value.encode()) for name, value in fixed.items()]
        self._ranges = ranges
        self._fidelity = fidelity
        self._is_integer = ranges is not None and ranges.dtype.kind in "iu"

    @classmethod
    def of(cls, lent: OpenVolume, kind: str, level: int, t: int, c: int) -> BrickHeaders:
        """Those of a volume that is open; reads its tables, and keeps them with it.

        Raises:
            VolumeFormatError: a table is missing or damaged.
        """
        key = (cls, kind, level, t, c)
        found = lent.kept.get(key)
        if found is None:
            made = cls._voxels if kind == "voxels" else cls._gradients
            found = made(lent, level, t, c)
            if len(lent.kept) >= _KEPT:
                lent.kept.pop(next(iter(lent.kept)), None)
            lent.kept[key] = found
        return found

    @classmethod
    def now(cls, lent: OpenVolume, kind: str, level: int, t: int, c: int) -> BrickHeaders:
        """The same without waiting.

        Raises:
            BlockingIOError: the tables were not read yet.
        """
        found: BrickHeaders | None = lent.kept.get((cls, kind, level, t, c))
        if found is None:
            raise BlockingIOError
        return found

    def of_brick(self, zyx: Zyx) -> RawHeaders:
        """All of them for one brick."""
        if self._ranges is None or self._fidelity is None:
            return self._fixed
        ranges, fidelity = self._ranges, self._fidelity
        if self._is_integer:  # a third of the time that numpy's own scalars take to become text
            low_high = b"%d,%d" % (ranges.item(*zyx, 0), ranges.item(*zyx, 1))
        else:  # as numpy writes its scalars: as many digits as the type has
            low_high = "{},{}".format(*ranges[zyx]).encode()
        return [
            *self._fixed,
            (b"x-octobrick-range", low_high),
            (b"x-octobrick-max-error", b"%.6g" % fidelity.item(*zyx, 0)),
            (b"x-octobrick-rmse", b"%.6g" % fidelity.item(*zyx, 1)),
        ]

    @classmethod
    def _voxels(cls, lent: OpenVolume, level: int, t: int, c: int) -> BrickHeaders:
        volume = lent.volume
        fixed = {
            "x-octobrick-codec": codec_text(volume.level_codec(level)),
            "x-octobrick-dtype": str(volume.dtype),
            "x-octobrick-shape": ",".join(str(n) for n in volume.brick_shape_zyx),
        }
        return cls(fixed, lent.ranges(level, t, c), lent.fidelity(level, t, c))

    @classmethod
    def _gradients(cls, lent: OpenVolume, _level: int, _t: int, _c: int) -> BrickHeaders:
        return cls(
            {
                "x-octobrick-codec": "directions",
                "x-octobrick-dtype": "uint8",
                "x-octobrick-shape": ",".join(str(n) for n in (*lent.volume.brick_shape_zyx, 3)),
            }
        )
