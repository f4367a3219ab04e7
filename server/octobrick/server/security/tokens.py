"""Bearer tokens: names for callers, what they may see, and hashes of their secrets."""

from __future__ import annotations

import fnmatch
import hashlib
import hmac
import json
import re
import secrets
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from octobrick.codec.errors import InvalidInputError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
_SHA256 = re.compile(r"[0-9a-f]{64}")
_PATTERN = re.compile(r"[A-Za-z0-9._*?\[\]!-]{1,256}")
_RESERVED_NAMES = frozenset({"signed"})  # the client's name of signed addresses
_TOKENS_MAX = 1_000  # each one is compared with what a client sends
_SECRET_NBYTES = 32  # 256 random bits: a plain hash keeps them, nothing can try them all
_PREFIX = "obk_"  # lets scanners of source code find a token that was left there


@dataclass(frozen=True, slots=True)
class Token:
    """One caller.

    Args:
        name: goes to logs, and to queues that are fair among callers.
        digest: SHA-256 of the secret.
        volumes: patterns of the volume ids that may be seen (``*``, ``?``, ``[…]``).
        expires_unix: end, in seconds since 1970; None for no end.
    """

    name: str
    digest: bytes
    volumes: tuple[str, ...]
    expires_unix: float | None

    def allows(self, volume_id: str) -> bool:
        """Whether this caller may see a volume of this id, whether there is one or not."""
        return any(fnmatch.fnmatchcase(volume_id, pattern) for pattern in self.volumes)

    @property
    def allows_all(self) -> bool:
        """Whether this caller may see whatever there is."""
        return "*" in self.volumes


def new_secret() -> str:
    """A token that nobody can guess, to be shown once."""
    return _PREFIX + secrets.token_urlsafe(_SECRET_NBYTES)


def token_entry(
    name: str, secret: str, volumes: tuple[str, ...], expires: datetime | None
) -> dict[str, Any]:
    """The entry of a tokens file for a new token.

    Raises:
        InvalidInputError: the name or a pattern is malformed.
    """
    entry: dict[str, Any] = {
        "name": name,
        "sha256": hashlib.sha256(secret.encode()).hexdigest(),
        "volumes": list(volumes),
    }
    if expires is not None:
        entry["expires"] = expires.isoformat(timespec="seconds")
    _parse_entry(entry, f"token {name!r:.80}")
    return entry


def parse_tokens(text: str) -> tuple[Token, ...]:
    """The tokens in the text of a tokens file.

    Raises:
        InvalidInputError: naming the entry that is malformed.
    """
    try:
        entries = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InvalidInputError(f"tokens file: not JSON ({error})") from error
    if not isinstance(entries, list) or len(entries) > _TOKENS_MAX:
        raise InvalidInputError(f"tokens file: must be a list of at most {_TOKENS_MAX} entries")
    tokens = tuple(
        _parse_entry(entry, f"tokens file, entry {i}") for i, entry in enumerate(entries)
    )
    for what in ("name", "digest"):
        values = [getattr(token, what) for token in tokens]
        if len(set(values)) < len(values):
            raise InvalidInputError(f"tokens file: two entries have the same {what}")
    return tokens


def find_token(tokens: tuple[Token, ...], secret: bytes) -> Token | None:
    """The token with this secret, expired or not; looks at all of them, however early it is found.

    Hashes are compared, in constant time: nothing can be learned of a secret by timing.
    """
    digest = hashlib.sha256(secret).digest()
    found = None
    for token in tokens:
        if hmac.compare_digest(token.digest, digest):
            found = token
    return found


def _parse_entry(entry: object, where: str) -> Token:
    if not isinstance(entry, dict) or not {"name", "sha256", "volumes"} <= entry.keys():
        raise InvalidInputError(f"{where}: must be an object with name, sha256 and volumes")
    unknown = entry.keys() - {"name", "sha256", "volumes", "expires"}
    if unknown:
        raise InvalidInputError(f"{where}: unknown field {min(map(str, unknown))!r:.80}")
    name, digest, volumes = entry["name"], entry["sha256"], entry["volumes"]
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name in _RESERVED_NAMES:
        raise InvalidInputError(
            f"{where}: name must be 1 to 64 letters, digits, dots, dashes and underscores, "
            f"the first one a letter or digit, and not 'signed', not {name!r:.80}"
        )
    if not isinstance(digest, str) or not _SHA256.fullmatch(digest):
        raise InvalidInputError(f"{where}: sha256 must be 64 digits of 0-9a-f")
    if not isinstance(volumes, list) or not volumes or not all(map(_is_pattern, volumes)):
        raise InvalidInputError(
            f'{where}: volumes must be a list of patterns such as "head*", not {volumes!r:.80}'
        )
    return Token(name, bytes.fromhex(digest), tuple(volumes), _parse_expiry(entry, where))


def _is_pattern(pattern: object) -> bool:
    return isinstance(pattern, str) and _PATTERN.fullmatch(pattern) is not None


def _parse_expiry(entry: dict[str, Any], where: str) -> float | None:
    if "expires" not in entry:
        return None
    try:
        expires = datetime.fromisoformat(entry["expires"])
    except (TypeError, ValueError):
        expires = None
    if expires is None or expires.tzinfo is None:
        raise InvalidInputError(
            f"{where}: expires must be a time with its zone, such as 2027-01-31T00:00:00Z, "
            f"not {entry['expires']!r:.80}"
        )
    return expires.timestamp()
