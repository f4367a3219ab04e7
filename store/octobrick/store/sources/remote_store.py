"""A store for zarr-python on a server: patient, bounded, and clear about what went wrong."""

from __future__ import annotations

import asyncio
import hashlib
import json
import threading
import time
from collections import OrderedDict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

from obstore.exceptions import PermissionDeniedError, UnauthenticatedError
from zarr.abc.store import (
    ByteRequest,
    OffsetByteRequest,
    RangeByteRequest,
    SuffixByteRequest,
)
from zarr.core.buffer import Buffer, BufferPrototype
from zarr.storage import ObjectStore

from octobrick.codec.errors import InvalidInputError, OctobrickError
from octobrick.store.errors import SourceError, SourceMismatchError, SourceUnreachableError
from octobrick.store.sources.location import Url
from octobrick.store.sources.reading import requesting
from octobrick.store.sources.remote_failure import explained, is_broken_off
from octobrick.store.sources.whole_store import METADATA

if TYPE_CHECKING:  # there are none at run time
    from obstore import GetResult, ObjectMeta

_METADATA_LIMIT_NBYTES = 1 << 26
_OBJECT_LIMIT_NBYTES = 1 << 31
# What is kept of answers: indices of shards, and chunks for boxes that share them.
_KEPT_NBYTES = 1 << 26
# An answer that broke off is asked for again, after twice as long each time.
_ATTEMPTS = 4
_PAUSE_SECONDS = 0.25
# How often, at most, it is asked whether the source is still what it was.
_CHECK_SECONDS = 5.0

Range = tuple[str, int, int] | None


class Stamp(NamedTuple):
    """What a server says of an object, whatever is in it; None where it does not say."""

    nbytes: int
    entity_tag: str | None
    modified: str | None

    @classmethod
    def of(cls, meta: ObjectMeta) -> Stamp:
        """The stamp in an answer."""
        modified: datetime = meta["last_modified"]
        # What stands for a time that the server did not give.
        known = modified.timestamp() > 0
        text = modified.astimezone(UTC).isoformat(timespec="seconds") if known else None
        return cls(meta["size"], meta["e_tag"], text)


class RemoteStore(ObjectStore[Any]):
    """Reads objects below an address.

    Attributes:
        refusal: the error of metadata that the server refused, which may not be there at all: S3
            says so only to those who may list the bucket.

    Args:
        url: what messages call it.
        store: of obstore.
    """

    def __init__(self, url: Url, store: Any) -> None:
        super().__init__(store, read_only=True)
        self.refusal: OctobrickError | None = None
        self._url = url
        self._stamps: dict[str, Stamp] = {}
        self._kept: OrderedDict[tuple[str, Range], Any] = OrderedDict()
        self._kept_nbytes = 0
        self._lock = threading.Lock()
        self._knows_ranges = False
        self._misses = False
        self._checked_seconds = time.monotonic()

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """The bytes of a key, or of a part of it; None where there is no such key.

        Raises:
            SourceUnreachableError: the server does not answer, or refuses to.
            SourceError: the answer is too large, or not what was asked for.
        """
        place = (key, _range_of(byte_range))
        value = self._take(place)
        if value is None:
            with requesting():
                value = await self._fetch(*place)
            if value is None:
                return None
            self._keep(place, value)
        return prototype.buffer.from_bytes(value)

    async def list_dir(self, prefix: str) -> Any:
        """The names below a key, where the server can tell.

        Raises:
            InvalidInputError: it cannot.
        """
        reason = "HTTP has no way to ask what is there"
        try:
            if self._url.scheme == "s3":
                async for name in super().list_dir(prefix):
                    yield name
                return
        except Exception as error:
            reason = explained(error, self._url, prefix).message
        raise InvalidInputError(
            f"{self._url}: is a group without an image or consolidated metadata, and cannot be "
            f"listed ({reason}); name the array or image with --dataset PATH (of bioformats2raw "
            "the first image is --dataset 0)",
            path=str(self._url),
        )

    def stamp(self) -> dict[str, Any]:
        """What the server says of the metadata that were read, JSON-ready, for a fingerprint."""
        stamps = sorted(self._stamps.items())
        digest = hashlib.blake2b(json.dumps(stamps).encode(), digest_size=16).hexdigest()
        return {
            "nfiles": len(stamps),
            "nbytes": sum(stamp.nbytes for _, stamp in stamps),
            "modified": max((stamp.modified or "" for _, stamp in stamps), default="") or None,
            "digest": digest,
        }

    def require_unchanged(self) -> None:
        """Ask for the metadata of the array again, if chunks were missing or it is a while ago.

        A chunk that is not there is one of fill values; so are all of a source that is gone.

        Raises:
            SourceUnreachableError: they are not there any more, or the server does not answer.
            SourceMismatchError: they have changed.
        """
        now = time.monotonic()
        if not (self._misses or now - self._checked_seconds > _CHECK_SECONDS):
            return
        self._misses, self._checked_seconds = False, now
        arrays = [key for key in self._stamps if key.endswith(("zarr.json", ".zarray"))]
        key = max(arrays, key=len)
        try:
            found = Stamp.of(self.store.get(key).meta)
        except FileNotFoundError as error:
            raise SourceUnreachableError(
                f"{self._url}: {key} is not there any more; put it back and run the same again",
                path=str(self._url),
                key=key,
            ) from error
        except Exception as error:
            raise explained(error, self._url, key) from error
        if found != self._stamps[key]:
            raise SourceMismatchError(
                f"{self._url}: {key} was changed while it was read: it was "
                f"{tuple(self._stamps[key])} and is {tuple(found)} (bytes, ETag, Last-Modified); "
                "begin again when it is complete",
                path=str(self._url),
                key=key,
            )

    async def _fetch(self, key: str, part: Range) -> Any:
        """The bytes from the server; asked again where they break off."""
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return await self._request(key, part)
            except FileNotFoundError:
                self._require_never_seen(key)
                return None
            except OctobrickError:
                raise
            except Exception as error:
                if is_broken_off(error) and attempt < _ATTEMPTS:
                    await asyncio.sleep(_PAUSE_SECONDS * 2**attempt)
                    continue
                failure = explained(error, self._url, key, knows_ranges=self._knows_ranges)
                if _is_metadata(key) and isinstance(
                    error, PermissionDeniedError | UnauthenticatedError
                ):
                    self.refusal = failure
                    return None
                raise failure from error
        return None

    async def _request(self, key: str, part: Range) -> Any:
        match part:
            case None:
                answer = await self.store.get_async(key)
            case ("suffix", nbytes, _):
                answer = await self.store.get_async(key, options={"range": {"suffix": nbytes}})
            case ("offset", start, _):
                answer = await self.store.get_async(key, options={"range": {"offset": start}})
            case (_, start, stop):
                answer = await self.store.get_async(key, options={"range": (start, stop)})
        self._require_sensible(key, answer)
        if _is_metadata(key) and key not in self._stamps:
            self._stamps[key] = Stamp.of(answer.meta)
        self._knows_ranges |= part is not None
        return await answer.bytes_async()

    def _require_sensible(self, key: str, answer: GetResult) -> None:
        """Refuse a web page, and more than any sensible object has, before they are read."""
        kind = str(answer.attributes.get("Content-Type", ""))
        if kind.startswith("text/html"):
            raise SourceUnreachableError(
                f"{self._url}: the server answers {key} with a web page ({kind}); it may want a "
                "login, or the address is one for people: give that of the data",
                path=str(self._url),
                key=key,
            )
        limit = _METADATA_LIMIT_NBYTES if _is_metadata(key) else _OBJECT_LIMIT_NBYTES
        start, stop = answer.range
        if stop - start > limit:
            raise SourceError(
                f"{self._url}: {key} has {stop - start} bytes, {limit} are the most that is read "
                "at once; read a smaller box, or save the array in smaller chunks",
                path=str(self._url),
                key=key,
            )

    def _require_never_seen(self, key: str) -> None:
        """Refuse to take for empty what was there a while ago."""
        if _is_metadata(key):
            return
        self._misses = True
        with self._lock:
            seen = any(kept == key for kept, _ in self._kept)
        if seen:
            raise SourceUnreachableError(
                f"{self._url}: {key} was there and is not any more; put it back and run the same "
                "again",
                path=str(self._url),
                key=key,
            )

    def _take(self, place: tuple[str, Range]) -> Any:
        with self._lock:
            value = self._kept.get(place)
            if value is not None:
                self._kept.move_to_end(place)
            return value

    def _keep(self, place: tuple[str, Range], value: Any) -> None:
        if _is_metadata(place[0]) or len(value) > _KEPT_NBYTES // 4:
            return
        with self._lock:
            if place not in self._kept:
                self._kept[place] = value
                self._kept_nbytes += len(value)
            while self._kept_nbytes > _KEPT_NBYTES:
                _, dropped = self._kept.popitem(last=False)
                self._kept_nbytes -= len(dropped)


def _is_metadata(key: str) -> bool:
    return key.rsplit("/", 1)[-1] in METADATA


def _range_of(byte_range: ByteRequest | None) -> Range:
    match byte_range:
        case None:
            return None
        case RangeByteRequest():
            return ("range", byte_range.start, byte_range.end)
        case OffsetByteRequest():
            return ("offset", byte_range.offset, 0)
        case SuffixByteRequest():
            return ("suffix", byte_range.suffix, 0)
