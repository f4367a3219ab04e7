"""One server over HTTP: pooled connections, time limits, retries, bodies of bounded size.

Redirects are never followed: what a server sends stays with the host that the caller named.
"""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from octobrick.codec.errors import InvalidInputError, OctobrickError, ResourceError
from octobrick.store.errors import ServerUnreachableError
from octobrick.store.http_address import VolumeAddress
from octobrick.store.retry import Retries, RetryPolicy
from octobrick.store.server_error import BODY_NBYTES_MAX, error_of_answer

if TYPE_CHECKING:
    from urllib3 import HTTPConnectionPool
    from urllib3.response import BaseHTTPResponse

RETRIED_STATUSES = frozenset((429, 502, 503, 504))
_PIECE_NBYTES = 1 << 18
_POOL_CONNECTIONS = 16


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How patient a client is.

    Attributes:
        connect_seconds: for a connection.
        read_seconds: without a byte.
        body_seconds: for a whole body, or for one brick of a stream.
        retry: what is done about failures.
    """

    connect_seconds: float = 10.0
    read_seconds: float = 30.0
    body_seconds: float = 120.0
    retry: RetryPolicy = field(default_factory=RetryPolicy)


@dataclass(frozen=True, slots=True)
class Answer:
    """An HTTP answer that was read to its end, its body as it was sent."""

    status: int
    encoding: str
    body: bytes


class TransientError(Exception):
    """What a retry may mend; the cause is the error to raise if it does not."""

    def __init__(self, error: OctobrickError, asked_seconds: float | None = None) -> None:
        super().__init__(error.message)
        self.error = error
        self.asked_seconds = asked_seconds


class Incoming:
    """The body of an answer that is still coming. One thread reads; any may cut it off."""

    def __init__(self, response: BaseHTTPResponse) -> None:
        self._response = response

    def pieces(self) -> Iterator[bytes]:
        """The body as it comes, undecoded.

        Raises:
            urllib3.exceptions.HTTPError: it was cut off.
        """
        while piece := self._response.read1(_PIECE_NBYTES, decode_content=False):
            yield piece

    def cut_off(self) -> None:
        """Wake who reads; no more comes. Never waits."""
        shutdown = getattr(self._response, "shutdown", None)
        if shutdown is not None:
            # Over already, or given back: then nobody waits for it.
            with contextlib.suppress(Exception):
                shutdown()


class HttpLink:
    """Requests to the server of one volume. Safe to use from several threads.

    Args:
        address: of the volume; nothing else is ever asked for.
        token: of the server; sent with every request, and to nobody else.
        options: how patient to be.

    Raises:
        ResourceError: urllib3 is not installed.
        InvalidInputError: a token that no header can hold.
    """

    def __init__(
        self, address: VolumeAddress, token: str | None, options: LinkOptions | None = None
    ) -> None:
        self._urllib3 = _urllib3()
        self._address = address
        self._options = options or LinkOptions()
        self._closed = threading.Event()
        self._headers = {"Accept-Encoding": "zstd", "User-Agent": "octobrick"}
        if token:
            if not (token.isascii() and token.isprintable()) or " " in token:
                raise InvalidInputError("token: has characters that no token has; check it")
            self._headers["Authorization"] = f"Bearer {token}"
        self._pool: HTTPConnectionPool = self._urllib3.connection_from_url(
            address.origin,
            maxsize=_POOL_CONNECTIONS,
            timeout=self._urllib3.Timeout(
                connect=self._options.connect_seconds, read=self._options.read_seconds
            ),
            retries=False,
        )

    @property
    def body_seconds(self) -> float:
        """For a whole body, or for one brick of a stream."""
        return self._options.body_seconds

    def close(self) -> None:
        """Close all connections that nobody uses; who waits to try again gives up."""
        self._closed.set()
        self._pool.close()

    def retries(self) -> Retries:
        """The failures of a task that begins now."""
        return Retries(self._options.retry, self._pause)

    def get(self, path: str, nbytes_max: int) -> Answer:
        """The answer, 200 or 204, to a request, tried again where that may help.

        Args:
            path: on this server.
            nbytes_max: of the body as it is sent; a longer one is refused.

        Raises:
            OctobrickError: what the server says; ServerUnreachableError where it says nothing.
        """
        retries = self.retries()
        while True:
            try:
                return self._get_once(path, nbytes_max)
            except TransientError as failure:
                retries.wait_after(failure.error, failure.asked_seconds)

    def _get_once(self, path: str, nbytes_max: int) -> Answer:
        with self.open("GET", path) as response:
            body = self._body(response, path, nbytes_max)
            encoding = response.headers.get("Content-Encoding", "identity").strip().lower()
            return Answer(response.status, encoding, body)

    @contextlib.contextmanager
    def open(self, method: str, path: str, body: bytes | None = None) -> Iterator[Any]:
        """An answer whose body is still to come; tried once.

        What urllib3 raises in the block is turned into `TransientError`, too.

        Raises:
            TransientError: worth another try.
            OctobrickError: what the server says.
        """
        where = self._address.shown(path)
        if self._closed.is_set():
            raise InvalidInputError(f"{where}: the volume is closed; open it anew")
        headers = self._headers | ({} if body is None else {"Content-Type": "application/json"})
        response = None
        try:
            response = self._pool.urlopen(
                method,
                path,
                body=body,
                headers=headers,
                retries=False,
                redirect=False,
                preload_content=False,
                decode_content=False,
            )
            if response.status not in (200, 204):
                self._raise_answer(response, path, where)
            yield response
            response.release_conn()
            response = None
        except (self._urllib3.exceptions.HTTPError, OSError) as error:
            if self._closed.is_set():
                raise InvalidInputError(f"{where}: the volume was closed meanwhile") from error
            raise TransientError(
                ServerUnreachableError(
                    f"{where}: the server does not answer, or breaks off ({_reason(error)}); "
                    "check the address, the network, and whether the server is up"
                )
            ) from error
        finally:
            if response is not None:  # not read to its end: of no use to another request
                response.close()

    def _raise_answer(self, response: Any, path: str, where: str) -> None:
        body = self._body(response, path, BODY_NBYTES_MAX)
        error = error_of_answer(response.status, body, where)
        if response.status in RETRIED_STATUSES:
            raise TransientError(error, _seconds(response.headers.get("Retry-After")))
        raise error

    def _body(self, response: Any, path: str, nbytes_max: int) -> bytes:
        deadline = time.monotonic() + self._options.body_seconds
        body = bytearray()
        for piece in Incoming(response).pieces():
            body += piece
            if len(body) > nbytes_max:
                raise ServerUnreachableError(
                    f"{self._address.shown(path)}: the answer is longer than the {nbytes_max} "
                    "bytes that it can have; check whether this is an octobrick server",
                    limit=nbytes_max,
                )
            if time.monotonic() > deadline:
                raise TransientError(
                    ServerUnreachableError(
                        f"{self._address.shown(path)}: the answer is not complete after "
                        f"{self._options.body_seconds:g} seconds; check the network"
                    )
                )
        return bytes(body)

    def _pause(self, seconds: float) -> None:
        if self._closed.wait(seconds):
            raise InvalidInputError(f"{self._address}: the volume was closed meanwhile")


def _urllib3() -> Any:
    try:
        return importlib.import_module("urllib3")
    except ImportError as error:
        raise ResourceError(
            "volumes on a server need urllib3, which is not installed: "
            "pip install 'octobrick[client]'",
            package="urllib3",
        ) from error


def _seconds(header: str | None) -> float | None:
    """Of a Retry-After header; a date counts as none."""
    if header is None or not header.strip().isdecimal() or len(header) > 9:
        return None
    return float(header)


def _reason(error: Exception) -> str:
    text = str(error).rsplit(">: ", 1)[-1]  # urllib3 begins with the object's own text
    return "".join(ch if ch.isprintable() else " " for ch in text[:160]) or type(error).__name__
