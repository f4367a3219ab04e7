"""One part of a volume, ingested once for each setting when it is first wanted."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from octobrick.codec.errors import InvalidInputError
from octobrick.measure.measurement import Setting
from octobrick.measure.pictures.paths import LEVELS
from octobrick.store import Volume, ingest, open_volume
from octobrick.store.brick_codec import BrickCodec


class Shelf:
    """Volumes of one array, open; a context manager that closes them.

    Args:
        part: (z, y, x) voxels, finite.
        spacing_xyz: world size of a voxel.
        folder: that exists and is empty; whoever made it deletes it.

    Raises:
        InvalidInputError: an array of other than three axes, or without a voxel.
    """

    def __init__(
        self, part: NDArray[Any], spacing_xyz: tuple[float, float, float], folder: Path
    ) -> None:
        if part.ndim != 3 or not part.size:
            raise InvalidInputError(
                f"a part of shape {part.shape} cannot be drawn; give (z, y, x), none of them 0"
            )
        self._folder = folder
        self._spacing_zyx = spacing_xyz[::-1]
        self._source = folder / "part.npy"
        self._volumes: dict[tuple[str, bool], Volume] = {}
        self._stack = ExitStack()
        self.nlevels = min(LEVELS, max(part.shape).bit_length())
        np.save(self._source, part, allow_pickle=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stack.close()

    def lossless(self) -> Volume:
        """The volume that holds the part as it is."""
        return self._stored("lossless", None, pyramid=True)

    def volume(self, setting: Setting, level: int) -> Volume:
        """A volume of a setting that has a level, and stored gradients where that is a coarse one.

        Raises:
            OctobrickError: of the ingest: voxels that are not finite, a codec not of their type.
        """
        if setting.codec is None:
            return self.lossless()
        return self._stored(setting.label, setting.codec, pyramid=level > 0)

    def _stored(self, label: str, codec: BrickCodec, *, pyramid: bool) -> Volume:
        """Without the pyramid, ingest takes half of the time: it is made where it is drawn."""
        key = (label, pyramid)
        if key not in self._volumes:
            dest = self._folder / f"{len(self._volumes)}.zarr"
            ingest(
                self._source,
                dest,
                codec=codec,
                levels=self.nlevels if pyramid else 1,
                gradients=pyramid and self.nlevels > 1,
                labels=False,  # names have no neighbours, but a picture of them has
                spacing=self._spacing_zyx,
            )
            self._volumes[key] = self._stack.enter_context(open_volume(dest))
        return self._volumes[key]
