"""A store for zarr-python that takes an empty file for a damage, not for a chunk of fill values."""

from __future__ import annotations

from pathlib import Path

from zarr.abc.store import ByteRequest, Store
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import WrapperStore

from octobrick.store.errors import TruncatedSourceError


class WholeStore(WrapperStore[Store]):
    """Reads another store; what exists there but holds nothing has been cut short.

    Args:
        store: where bytes come from.
        path: what messages call it.
    """

    def __init__(self, store: Store, path: Path) -> None:
        super().__init__(store)
        self._path = path

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """The bytes of a key, or None where there is no such key.

        Raises:
            TruncatedSourceError: there is one, without a byte.
        """
        value = await super().get(key, prototype, byte_range)
        if value is not None and len(value) == 0:
            raise TruncatedSourceError(
                f"{self._path}: {key} is empty; copy or export the data again",
                path=str(self._path),
                key=key,
            )
        return value
