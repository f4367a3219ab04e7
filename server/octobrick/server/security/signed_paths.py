"""Signed, expiring addresses: a path prefix that lets its holder use one volume for a while.

``/signed/{expires_unix}/{signature}`` goes before ``/v1/volumes/{id}``, ``/zarr/{id}``,
``/zarr2/{id}`` or ``/precomputed/{id}``, so that any client can take it as the start of a base
address. The signature is HMAC-SHA256, base64url without padding, of the volume's id and the expiry.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import re
from dataclasses import dataclass

from octobrick.codec.errors import InvalidInputError

# What is signed begins with this, so that a key used for something else as well signs no address.
_PURPOSE = "octobrick signed path 1"
_KEY_LENGTH_MIN = 32  # characters; below, a key could be guessed from one address
_PREFIX = re.compile(r"/signed/(0|[1-9][0-9]{0,11})/([A-Za-z0-9_-]{43})(?=/)")
_SECRET = re.compile(r"(/signed/[^/]*/)[^/]+")


@dataclass(frozen=True, slots=True)
class SignedPrefix:
    """The prefix of a signed address, as it was sent: nothing in it is checked yet.

    Args:
        length: characters of the path that it takes.
    """

    expires_text: str
    signature: str
    length: int

    @property
    def expires_unix(self) -> int:
        """When the address ends, in seconds since 1970."""
        return int(self.expires_text)


def parse_prefix(path: str) -> SignedPrefix | None:
    """The prefix of a path that begins with one; None where it is malformed or there is none."""
    match = _PREFIX.match(path)
    return None if match is None else SignedPrefix(match[1], match[2], match.end())


def signed_prefix(key: bytes, volume_id: str, expires_unix: int) -> str:
    """The prefix that gives a volume until ``expires_unix``."""
    return f"/signed/{expires_unix}/{_signature(key, volume_id, str(expires_unix))}"


def is_signed(prefix: SignedPrefix, volume_id: str, keys: tuple[bytes, ...]) -> bool:
    """Whether one of the keys made this prefix for this volume. Takes the same time for any."""
    sent = prefix.signature.encode("ascii")
    # The texts are compared: base64 would let some signatures be spelled in several ways.
    good = [
        hmac.compare_digest(sent, _signature(key, volume_id, prefix.expires_text).encode())
        for key in keys
    ]
    return any(good)


def without_signature(path: str) -> str:
    """A path with the secret of its signed prefix, well-formed or not, replaced by an ellipsis."""
    return _SECRET.sub(r"\1...", path) if "/signed/" in path else path


def parse_keys(text: str, where: str) -> tuple[bytes, ...]:
    """The keys in a text, one a line: the first one signs, all are good for checking.

    Raises:
        InvalidInputError: there is none, or one is too short to be a secret.
    """
    keys = tuple(line.strip().encode() for line in text.splitlines() if line.strip())
    if not keys:
        raise InvalidInputError(f"{where}: no key in it; write one with 'openssl rand -base64 32'")
    shortest = min(len(key) for key in keys)
    if shortest < _KEY_LENGTH_MIN:
        raise InvalidInputError(
            f"{where}: a key has {shortest} characters, it needs {_KEY_LENGTH_MIN}; write one "
            "with 'openssl rand -base64 32'",
            length=shortest,
            minimum=_KEY_LENGTH_MIN,
        )
    return keys


def _signature(key: bytes, volume_id: str, expires_text: str) -> str:
    message = "\n".join((_PURPOSE, expires_text, volume_id)).encode()
    digest = hmac.digest(key, message, hashlib.sha256)
    return base64.urlsafe_b64encode(digest).rstrip(b"=").decode("ascii")
