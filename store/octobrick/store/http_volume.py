"""A volume on an octobrick server, read as one on disk is."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from octobrick.codec.errors import CorruptBrickError
from octobrick.store import frame as zstd_frame
from octobrick.store.attributes import VolumeAttributes
from octobrick.store.box import Zyx
from octobrick.store.brick_cache import BrickCache
from octobrick.store.brick_stream import Kind, stored_nbytes_max
from octobrick.store.errors import ServerUnreachableError, VolumeFormatError
from octobrick.store.http_address import volume_address
from octobrick.store.http_link import HttpLink, LinkOptions
from octobrick.store.layout import METADATA_NBYTES_MAX
from octobrick.store.level import Level
from octobrick.store.remote_bricks import BrickBatch, Place, RemoteBricks, codes_of
from octobrick.store.stored_gradients import DirectionCodes, StoredGradients
from octobrick.store.volume import TableKind, Volume, Voxels

_DETAIL_NBYTES_MAX = 2**20
_TABLE_NBYTES_MAX = 1 << 30  # a table of 2^26 bricks of float32, 16 TB of bytes: more is not ours
_REVISION = re.compile("[0-9a-f]{1,128}")


class HttpVolume(Volume):
    """A volume on a server. Safe to use from several threads.

    Bricks and tables are kept on disk by their revision (docs/client.md). Failures that pass are
    waited for; what comes is checked before it is kept or given.

    Args:
        url: ``http://host/v1/volumes/ID``.
        token: for that server; by default what ``OCTOBRICK_TOKEN`` holds.
        cache: where bytes are kept; by default the user's own.
        options: how patient to be.

    Raises:
        InvalidInputError, VolumeNotFoundError, VolumeFormatError, ServerUnreachableError: as
            `octobrick.store.open_volume`.
    """

    def __init__(
        self,
        url: str,
        *,
        token: str | None = None,
        cache: BrickCache | None = None,
        options: LinkOptions | None = None,
    ) -> None:
        self._address = volume_address(url)
        token = os.environ.get("OCTOBRICK_TOKEN") if token is None else token
        self._cache = BrickCache.usual() if cache is None else cache
        self._link = HttpLink(self._address, token, options)
        try:
            revision = self._current_revision()
            attributes = self._fetched_attributes(revision)
            super().__init__(self._address.volume_id, revision, attributes)
        except BaseException:
            self._link.close()
            raise
        self._bricks = RemoteBricks(
            self._link,
            self._address,
            revision,
            Kind.VOXELS,
            self._cache,
            self.code_nbytes_max,
            self.decompressed,
        )
        levels = self._gradient_levels()
        if levels:
            self.gradients = HttpGradients(
                self._address.volume_id,
                self.levels,
                levels,
                self.brick_shape_zyx,
                RemoteBricks(
                    self._link,
                    self._address,
                    revision,
                    Kind.GRADIENTS,
                    self._cache,
                    lambda _: self._gradient_nbytes,
                    self._gradient_codes,
                ),
            )

    def close(self) -> None:
        """Close all connections."""
        self._link.close()

    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's bytes as on the server's disk, one zstd frame; None where it is absent.

        Raises:
            InvalidInputError: no such level or brick.
            CorruptBrickError: it came damaged twice, or is damaged on the server.
            RevisionGoneError: the volume was replaced.
            ServerUnreachableError: no answer, for as long as it is waited for.
        """
        self._require_brick(level, zyx, t, c)
        return self._bricks.stored((level, zyx, t, c))

    def brick_code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick without the entropy layer; None where it is absent.

        Raises:
            As `stored_brick`.
        """
        self._require_brick(level, zyx, t, c)
        return self._bricks.code((level, zyx, t, c))

    def brick_codes(self, places: Sequence[Place]) -> BrickBatch:
        """What `brick_code` gives of many bricks, in few requests, each as soon as it is here.

        Args:
            places: (level, (z, y, x), t, c) of each.

        Raises:
            InvalidInputError: no such level or brick.
        """
        for place in places:
            self._require_brick(*place)
        return self._bricks.batch(places)

    def _bricks_at(
        self, level: int, places: Iterable[Zyx], t: int, c: int
    ) -> Iterator[tuple[Zyx, Voxels]]:
        asked = [(level, zyx, t, c) for zyx in places]
        for (_, zyx, _, _), code in codes_of(asked, self.brick_codes(asked)):
            yield zyx, self._decoded(code, level, zyx, t, c)

    def _small_array(self, kind: TableKind, level: int, t: int, c: int) -> Voxels:
        grid_zyx = self.level(level).grid_zyx
        self._require_brick(level, (0, 0, 0), t, c)
        dtype = self.dtype if kind == "range" else np.dtype(np.float32)
        dtype = dtype.newbyteorder("<")
        nbytes = math.prod(grid_zyx) * 2 * dtype.itemsize
        path = self._address.table_path(self.revision, kind, level, t, c)
        if nbytes > _TABLE_NBYTES_MAX:
            raise VolumeFormatError(
                f"{self._address.shown(path)}: a table of {nbytes} bytes is not read, at most "
                f"{_TABLE_NBYTES_MAX} are"
            )
        key = f"{self.revision} {kind} {level} {t} {c}"
        kept = self._cache.get(key)
        if kept is not None and kept.payload is not None:
            try:
                content = zstd_frame.decompress(kept.payload, nbytes)
                return np.frombuffer(content, dtype).reshape(*grid_zyx, 2).astype(dtype.name)
            except CorruptBrickError:
                self._cache.drop(key)
        answer = self._link.get(path, stored_nbytes_max(nbytes))
        frame = answer.body
        if answer.encoding == "identity":
            frame = zstd_frame.compress(frame, level=1)
        try:
            content = zstd_frame.decompress(frame, nbytes)
        except CorruptBrickError as error:
            raise VolumeFormatError(
                f"{self._address.shown(path)}: the table came damaged: {error.message}; try again"
            ) from error
        self._cache.put(key, frame)
        return np.frombuffer(content, dtype).reshape(*grid_zyx, 2).astype(dtype.name)

    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        return self._bricks.where((level, zyx, t, c))

    @property
    def _gradient_nbytes(self) -> int:
        return 3 * math.prod(self.brick_shape_zyx)

    def _gradient_codes(self, stored: bytes, _level: int) -> bytes:
        return zstd_frame.decompress(stored, self._gradient_nbytes)

    def _current_revision(self) -> str:
        path = self._address.volume_path
        fields = self._json(self._link.get(path, _DETAIL_NBYTES_MAX).body, path)
        revision = fields.get("revision") if isinstance(fields, dict) else None
        if not isinstance(revision, str) or not _REVISION.fullmatch(revision):
            raise ServerUnreachableError(
                f"{self._address}: what answers has no revision, so it is no octobrick server; "
                "check the address"
            )
        return revision

    def _fetched_attributes(self, revision: str) -> VolumeAttributes:
        path, key = self._address.attributes_path(revision), f"{revision} attributes"
        where = self._address.shown(path)
        kept = self._cache.get(key)
        if kept is not None and kept.payload is not None:
            return VolumeAttributes.from_json(self._json(kept.payload, path), where)
        answer = self._link.get(path, METADATA_NBYTES_MAX)
        body = answer.body
        if answer.encoding == "zstd":
            try:
                body = zstd_frame.decompress(body, METADATA_NBYTES_MAX, at_most=True)
            except CorruptBrickError as error:
                raise VolumeFormatError(f"{where}: came damaged: {error.message}") from error
        fields = self._json(body, path)
        attributes = VolumeAttributes.from_json(fields, where)
        if fields.get("revision") != revision:
            raise VolumeFormatError(
                f"{where}: these are attributes of revision {fields.get('revision')!r:.60}, not "
                f"of {revision}; check what lies between you and the server"
            )
        self._cache.put(key, body)
        return attributes

    def _json(self, body: bytes, path: str) -> Any:
        try:
            return json.loads(body)
        except (ValueError, RecursionError):
            raise ServerUnreachableError(
                f"{self._address.shown(path)}: answers something else than JSON; check whether "
                "this is an octobrick server"
            ) from None


class HttpGradients(StoredGradients):
    """The gradients of a volume on a server."""

    def __init__(
        self,
        name: str,
        volume_levels: Sequence[Level],
        levels: tuple[int, ...],
        brick_shape_zyx: Zyx,
        bricks: RemoteBricks,
    ) -> None:
        super().__init__(name, volume_levels, levels, brick_shape_zyx)
        self._bricks = bricks

    def close(self) -> None:
        """Nothing: the connections are the volume's."""

    def stored_brick(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's codes as on the server's disk; None where no voxel has a direction.

        Raises:
            As `HttpVolume.stored_brick`.
        """
        self._require(level, zyx)
        return self._bricks.stored((level, zyx, t, c))

    def code(self, level: int, zyx: Zyx, t: int = 0, c: int = 0) -> bytes | None:
        """A brick's codes without the entropy layer; None where no voxel has a direction.

        Raises:
            As `HttpVolume.stored_brick`.
        """
        self._require(level, zyx)
        return self._bricks.code((level, zyx, t, c))

    def brick_codes(self, places: Sequence[Place]) -> BrickBatch:
        """What `code` gives of many bricks, each as soon as it is here.

        Args:
            places: (level, (z, y, x), t, c) of each.

        Raises:
            InvalidInputError: no such level or brick.
        """
        for level, zyx, _, _ in places:
            self._require(level, zyx)
        return self._bricks.batch(places)

    def _bricks_at(
        self, level: int, places: Iterable[Zyx], t: int, c: int
    ) -> Iterator[tuple[Zyx, DirectionCodes]]:
        asked = [(level, zyx, t, c) for zyx in places]
        for (_, zyx, _, _), code in codes_of(asked, self.brick_codes(asked)):
            yield zyx, self._shaped(code)

    def _where(self, level: int, zyx: Zyx, t: int, c: int) -> str:
        return self._bricks.where((level, zyx, t, c))
