"""Messages over a socket between two processes: JSON and bytes, each with its length before it."""

from __future__ import annotations

import json
import select
import socket
import struct
import time
from typing import Any, Final

_HEADER: Final = struct.Struct("<4sIQ")  # magic, bytes of JSON, bytes of payload
_MAGIC: Final = b"OBKP"
TEXT_MAX_NBYTES: Final = 1 << 20
"""A request is limited by `max_body_nbytes`; this bounds what a broken peer can make one take."""
_CHUNK_NBYTES: Final = 1 << 20


class MessageError(Exception):
    """The other side sent what is no message, stopped in the middle of one, or is too slow."""


class MessagePipe:
    """One end. One thread sends and one receives, at most.

    Args:
        sock: a connected stream socket; closed with the pipe.
        payload_max_nbytes: longer payloads are refused before they are read.
    """

    def __init__(self, sock: socket.socket, payload_max_nbytes: int) -> None:
        self._socket = sock
        self._payload_max_nbytes = payload_max_nbytes
        self._poll = select.poll()  # unlike select(), it takes descriptors above 1023
        self._poll.register(sock, select.POLLIN)

    def send(self, message: dict[str, Any], payload: bytes = b"") -> None:
        """Send a message; blocks until the other side has taken most of it.

        Raises:
            OSError: the other side is gone.
            MessageError: the message is too long.
        """
        text = json.dumps(message).encode()
        if len(text) > TEXT_MAX_NBYTES or len(payload) > self._payload_max_nbytes:
            raise MessageError(f"a message of {len(text)} and {len(payload)} bytes is too long")
        self._socket.sendall(_HEADER.pack(_MAGIC, len(text), len(payload)) + text)
        if payload:
            self._socket.sendall(payload)

    def arrives(self, seconds: float) -> bool:
        """Whether a message, or the end, can be received within a time."""
        return bool(self._poll.poll(1e3 * seconds))

    def receive(self, deadline: float | None = None) -> tuple[dict[str, Any], bytes]:
        """The next message; blocks until it is there, or until ``time.monotonic()`` is past.

        Raises:
            EOFError: the other side is gone.
            MessageError: see there.
            OSError: of the socket.
        """
        magic, text_nbytes, payload_nbytes = _HEADER.unpack(
            self._exactly(_HEADER.size, deadline, may_end=True)
        )
        if (
            magic != _MAGIC
            or text_nbytes > TEXT_MAX_NBYTES
            or payload_nbytes > self._payload_max_nbytes
        ):
            raise MessageError(
                f"no message begins with {magic!r}, {text_nbytes} and {payload_nbytes} bytes"
            )
        try:
            message = json.loads(self._exactly(text_nbytes, deadline))
        except ValueError as error:
            raise MessageError(f"not JSON: {error}") from error
        if not isinstance(message, dict):
            raise MessageError("no JSON object")
        return message, self._exactly(payload_nbytes, deadline)

    def close(self) -> None:
        """Close the socket: the other side sees the end."""
        self._socket.close()

    def _exactly(self, nbytes: int, deadline: float | None, *, may_end: bool = False) -> bytes:
        parts = bytearray()
        while len(parts) < nbytes:
            if deadline is not None and not self.arrives(max(0.0, deadline - time.monotonic())):
                raise MessageError(f"stopped after {len(parts)} of {nbytes} bytes")
            part = self._socket.recv(min(nbytes - len(parts), _CHUNK_NBYTES))
            if not part:
                if may_end and not parts:
                    raise EOFError
                raise MessageError(f"ended after {len(parts)} of {nbytes} bytes")
            parts += part
        return bytes(parts)
