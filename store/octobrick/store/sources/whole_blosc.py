"""Blosc chunks inside shards, whose own sizes are compared with what there is.

Outside of shards `WholeStore` does it; the chunks of a shard never pass through a store alone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from zarr.abc.codec import Codec
from zarr.codecs import BloscCodec, ShardingCodec
from zarr.core.array_spec import ArraySpec
from zarr.core.buffer import Buffer
from zarr.core.metadata.v3 import ArrayV3Metadata

from octobrick.store.sources.whole_store import blosc_nbytes


class WholeBlosc(BloscCodec):
    """Blosc that refuses a chunk which is not as long as its header says."""

    async def _decode_single(self, chunk_bytes: Buffer, chunk_spec: ArraySpec) -> Buffer:
        said = blosc_nbytes(chunk_bytes)
        if said != len(chunk_bytes):
            raise ValueError(
                f"a chunk in a shard has {len(chunk_bytes)} bytes, its blosc header says {said}"
            )
        return await super()._decode_single(chunk_bytes, chunk_spec)


def checked(array: Any) -> Any:
    """An array of zarr-python; if it has shards with blosc in them, read with `WholeBlosc`."""
    if not isinstance(array.metadata, ArrayV3Metadata):
        return array
    codecs = tuple(map(_checked, array.metadata.codecs))
    if codecs == array.metadata.codecs:
        return array
    inner = array._async_array
    metadata = replace(array.metadata, codecs=codecs)
    return type(array)(type(inner)(metadata, inner.store_path, inner.config))


def _checked(codec: Codec) -> Codec:
    if isinstance(codec, ShardingCodec):
        inner = tuple(map(_checked_inside, codec.codecs))
        return codec if inner == codec.codecs else replace(codec, codecs=inner)
    return codec


def _checked_inside(codec: Codec) -> Codec:
    if isinstance(codec, BloscCodec):
        return WholeBlosc(
            typesize=codec.typesize,
            cname=codec.cname,
            clevel=codec.clevel,
            shuffle=codec.shuffle,
            blocksize=codec.blocksize,
        )
    return _checked(codec)
