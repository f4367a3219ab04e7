"""A store for zarr-python that refuses chunks which were cut short.

Zarr takes an empty file for a chunk of fill values, and c-blosc believes the size that the first
bytes of a chunk name, and reads beyond the end of one that is shorter.
"""

from __future__ import annotations

from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import WrapperStore

from octobrick.store.errors import TruncatedSourceError
from octobrick.store.sources.location import Location

METADATA = ("zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata")
_BLOSC_HEADER_NBYTES = 16


class WholeStore(WrapperStore[Store]):
    """Reads another store; what exists there but holds nothing has been cut short.

    Attributes:
        has_blosc: whether chunks are blosc's, whose own sizes are compared with what there is.

    Args:
        store: where bytes come from.
        path: what messages call it.
    """

    def __init__(self, store: Store, path: Location) -> None:
        super().__init__(store)
        self._path = path
        self.has_blosc = False

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """The bytes of a key, or None where there is no such key.

        Raises:
            TruncatedSourceError: there is one, without a byte or cut short.
        """
        value = await super().get(key, prototype, byte_range)
        if value is not None and len(value) == 0:
            raise TruncatedSourceError(
                f"{self._path}: {key} is empty; copy or export the data again",
                path=str(self._path),
                key=key,
            )
        if value is not None and self.has_blosc and key.rsplit("/", 1)[-1] not in METADATA:
            self._require_whole(key, value)
        return value

    def _require_whole(self, key: str, value: Buffer) -> None:
        """Compare the length of a chunk with the one in its header."""
        nbytes, said = len(value), blosc_nbytes(value)
        if said != nbytes:
            raise TruncatedSourceError(
                f"{self._path}: {key} has {nbytes} bytes, its blosc header says {said}; copy or "
                "export the data again",
                path=str(self._path),
                key=key,
                expected_nbytes=said,
                actual_nbytes=nbytes,
            )


def blosc_nbytes(chunk: Buffer) -> int:
    """How long a chunk of blosc says that it is, in bytes 12 to 15; a header at least."""
    said = int.from_bytes(chunk[12:_BLOSC_HEADER_NBYTES].to_bytes(), "little")
    return max(said, _BLOSC_HEADER_NBYTES)
