"""The answer to a request in another protocol's words: revisions, caches, encodings, ranges."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import zstandard

from octobrick.server.byte_cache import ByteCache
from octobrick.server.catalog import Catalog, OpenVolume
from octobrick.server.interop.byte_range import byte_range
from octobrick.server.interop.resources import Chunk, Document, Resource, nothing
from octobrick.server.reply import (
    IMMUTABLE,
    Headers,
    Reply,
    accepts_zstd,
    matches_etag,
    require_revision,
)
from octobrick.store import LocalVolume

ChunkKey = tuple[str, ...]
"""Id and revision of the volume, then the name of the chunk."""

ChunkCache = ByteCache[ChunkKey]


@dataclass(frozen=True, slots=True)
class Question:
    """What a request asks for.

    Args:
        volume_id: which volume.
        revision: the only one that will do, or None.
        key: of the document or chunk, as the protocol has it.
        headers: of the request, by their names in lower case.
    """

    volume_id: str
    revision: str | None
    key: str
    headers: Headers

    def header(self, name: str) -> str:
        """A header's value, empty where there is none."""
        return self.headers.get(name, "")


def parse_name(name: str) -> tuple[str, str | None]:
    """Volume id and revision of the part of an address that is ``{id}`` or ``{id}@{revision}``."""
    volume_id, at, revision = name.partition("@")
    return volume_id, revision if at else None


def interop_reply(
    catalog: Catalog,
    cache: ChunkCache,
    find: Callable[[LocalVolume, str], Resource],
    question: Question,
) -> Reply:
    """Answer a request: 200, 206 for a part, or 304.

    Safe to call from any thread; blocks on the disk and on the codec.

    Args:
        catalog: has the volume.
        cache: keeps the chunks that had to be made.
        find: what a key names in the protocol that is asked for.
        question: the request.

    Raises:
        VolumeNotFoundError: no volume has this id.
        RevisionGoneError: the volume has another revision than the one that is asked for.
        NotFoundError: the key names nothing, or an absent chunk.
        UnsupportedError: the protocol has no words for this volume.
        CorruptDataError: the volume cannot be read as it was written.
    """
    while True:
        revision, resource = catalog.read(
            question.volume_id, lambda lent: _look(lent, find, question)
        )
        if isinstance(resource, Document):
            return _document_reply(resource, question)
        try:
            return _chunk_reply(catalog, cache, question, revision, resource)
        except _ReplacedError:
            continue


class _ReplacedError(Exception):
    """The volume was replaced between two looks at it: look again."""


def _look(
    lent: OpenVolume, find: Callable[[LocalVolume, str], Resource], question: Question
) -> tuple[str, Resource]:
    if question.revision is not None:
        require_revision(lent.volume, question.volume_id, question.revision)
    return lent.volume.revision, find(lent.volume, question.key)


def _document_reply(document: Document, question: Question) -> Reply:
    digest = hashlib.blake2b(document.body, digest_size=16).hexdigest()
    headers = _validators(question, f'"{digest}"')
    if _is_known(question, headers):
        return Reply(304, headers, b"")
    headers |= {"content-type": "application/json", "content-length": str(len(document.body))}
    return Reply(200, headers, document.body)


def _chunk_reply(
    catalog: Catalog, cache: ChunkCache, question: Question, revision: str, chunk: Chunk
) -> Reply:
    encoded = not chunk.is_content and accepts_zstd(question.header("accept-encoding"))
    coding = "zstd" if encoded or chunk.is_content else "identity"
    headers = _validators(question, f'"{revision}-{".".join(chunk.name)}-{coding}"')
    if not chunk.is_content:
        headers["vary"] = "Accept-Encoding"
    if _is_known(question, headers):
        return Reply(304, headers, b"")
    frame = _frame(catalog, cache, question.volume_id, revision, chunk)
    if frame is None:
        raise nothing(question.key)
    body = frame if encoded or chunk.is_content else zstandard.decompress(frame)
    headers |= {"content-type": "application/octet-stream", "accept-ranges": "bytes"}
    if encoded:
        headers["content-encoding"] = "zstd"
    return _part(body, headers, question)


def _frame(
    catalog: Catalog, cache: ChunkCache, volume_id: str, revision: str, chunk: Chunk
) -> bytes | None:
    """The chunk of this very revision, kept only once it is sure to be that."""

    def use(lent: OpenVolume) -> bytes | None:
        if lent.volume.revision != revision:
            raise _ReplacedError
        return chunk.read(lent.volume)

    def make() -> bytes | None:
        return catalog.read(volume_id, use)

    return make() if chunk.is_stored else cache.get((volume_id, revision, *chunk.name), make)


def _validators(question: Question, etag: str) -> Headers:
    pinned = question.revision is not None
    return {"etag": etag, "cache-control": IMMUTABLE if pinned else "no-cache"}


def _is_known(question: Question, headers: Headers) -> bool:
    if_none_match = question.header("if-none-match")
    return bool(if_none_match) and matches_etag(if_none_match, headers["etag"])


def _part(body: bytes, headers: Headers, question: Question) -> Reply:
    """The whole body, or the range of it that is asked for."""
    if_range = question.header("if-range")
    wanted = byte_range(question.header("range"), len(body))
    if wanted is None or (if_range and if_range != headers["etag"]):
        return Reply(200, headers | {"content-length": str(len(body))}, body)
    part = body[wanted.start : wanted.stop]
    headers |= {
        "content-range": f"bytes {wanted.start}-{wanted.stop - 1}/{len(body)}",
        "content-length": str(len(part)),
    }
    return Reply(206, headers, part)
