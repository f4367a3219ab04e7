"""Zstandard frames: the entropy layer that a brick wears on disk and on the wire only.

Each frame carries its content size and a checksum (RFC 8878: the low 32 bits of XXH64 of the
content), so a reader knows how much memory a brick takes before it takes it, and knows damage
when it sees it.
"""

from __future__ import annotations

import threading

import xxhash
import zstandard

from octobrick.codec.errors import CorruptBrickError

_CHECKSUM_FLAG = 0x04  # bit 2 of the frame header descriptor, the byte after the magic number
_CHECKSUM_NBYTES = 4

_local = threading.local()  # contexts are costly to make and not safe to share between threads


def compress(content: bytes | memoryview, level: int) -> bytes:
    """One zstd frame with content size and checksum. Thread-safe; releases the GIL."""
    contexts: dict[int, zstandard.ZstdCompressor] = _local.__dict__.setdefault("compressors", {})
    context = contexts.get(level)
    if context is None:
        context = contexts[level] = zstandard.ZstdCompressor(
            level=level, write_checksum=True, write_content_size=True
        )
    return context.compress(content)


def decompress(frame: bytes, content_nbytes: int, *, at_most: bool = False) -> bytes:
    """The content of a frame that must be exactly, or at most, ``content_nbytes`` long.

    Nothing is allocated on the word of the frame alone. Thread-safe; releases the GIL.

    Raises:
        CorruptBrickError: the frame is damaged, or its content has another size. Where only the
            checksum disagrees, the error names the stored and the computed one.
    """
    try:
        parameters = zstandard.get_frame_parameters(frame)
    except zstandard.ZstdError as error:
        raise CorruptBrickError(f"not a zstd frame ({error})", nbytes=len(frame)) from None
    fits = parameters.content_size <= content_nbytes  # 2^64 − 1 and − 2 where there is none
    if not (fits if at_most else parameters.content_size == content_nbytes):
        raise CorruptBrickError(
            f"the zstd frame announces {parameters.content_size} bytes of content, "
            f"the brick's codec needs {'at most ' if at_most else ''}{content_nbytes}",
            announced_nbytes=parameters.content_size,
            expected_nbytes=content_nbytes,
        )
    content_nbytes = parameters.content_size
    try:
        return _decompressor().decompress(
            frame, max_output_size=content_nbytes, allow_extra_data=False
        )
    except zstandard.ZstdError as error:
        raise _explain_damage(frame, parameters.has_checksum, content_nbytes, error) from None


def _decompressor() -> zstandard.ZstdDecompressor:
    context: zstandard.ZstdDecompressor | None = getattr(_local, "decompressor", None)
    if context is None:
        context = _local.decompressor = zstandard.ZstdDecompressor()
    return context


def _explain_damage(
    frame: bytes, has_checksum: bool, content_nbytes: int, error: zstandard.ZstdError
) -> CorruptBrickError:
    """Decode once more without the checksum, to name both sums if that is all that is wrong."""
    if has_checksum and len(frame) > 5 + _CHECKSUM_NBYTES:
        bare = frame[:4] + bytes([frame[4] & ~_CHECKSUM_FLAG]) + frame[5:-_CHECKSUM_NBYTES]
        try:
            content = _decompressor().decompress(bare, max_output_size=content_nbytes)
        except zstandard.ZstdError:
            pass
        else:
            stored = int.from_bytes(frame[-_CHECKSUM_NBYTES:], "little")
            computed = xxhash.xxh64_intdigest(content) & 0xFFFFFFFF
            return CorruptBrickError(
                f"checksum mismatch: the frame stores {stored:08x}, its content gives "
                f"{computed:08x}",
                stored_checksum=f"{stored:08x}",
                computed_checksum=f"{computed:08x}",
            )
    return CorruptBrickError(f"the zstd frame does not decode ({error})", nbytes=len(frame))
