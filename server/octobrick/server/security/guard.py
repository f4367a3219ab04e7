"""Who may see what: decides on each request from its token or its signed prefix.

A decision never asks whether a volume exists: what a caller may not see is refused by its id
alone, in the same words and time, so that nothing leaks of what there is.
"""

from __future__ import annotations

import re
import stat
import time
from collections.abc import Callable
from dataclasses import dataclass

from starlette.types import Scope

from octobrick.codec.errors import InvalidInputError
from octobrick.server.errors import ForbiddenError, UnauthorizedError
from octobrick.server.security.signed_paths import is_signed, parse_keys, parse_prefix
from octobrick.server.security.tokens import Token, find_token, parse_tokens
from octobrick.server.security.watched_file import WatchedFile
from octobrick.server.settings import Settings

# Whatever is not listed here needs a token: a route added later is closed until someone opens it.
_OPEN_PATHS = frozenset({"/healthz", "/readyz", "/metrics", "/docs", "/openapi.json"})
# Leave for a volume is leave for each of its revisions, which only interop's addresses name so.
_VOLUME = re.compile(r"/(?:v1/volumes/([^/]+)|(?:zarr2?|precomputed)/([^/@]+)(?:@[^/]*)?)(?:/|\Z)")
_LIST = "/v1/volumes"
_SIGNED = "/signed/"


@dataclass(frozen=True, slots=True)
class Access:
    """What the caller of one request may see.

    Args:
        client: the caller's name, for logs and fair queues.
        allows: whether the caller may see a volume of this id.
        expires_unix: end of a signed address; None where a token was shown.
        prefix: what the addresses of this caller begin with; empty where a token was shown.
    """

    client: str
    allows: Callable[[str], bool]
    expires_unix: int | None = None
    prefix: str = ""


class Guard:
    """Lets requests in, or refuses them. For the event loop's thread alone.

    Args:
        tokens: the tokens that are good now.
        keys: the keys that signed addresses are checked with; empty where there are none.
        now: seconds since 1970.
    """

    def __init__(
        self,
        tokens: Callable[[], tuple[Token, ...]],
        keys: Callable[[], tuple[bytes, ...]],
        now: Callable[[], float] = time.time,
    ) -> None:
        self._tokens = tokens
        self._keys = keys
        self._now = now

    def admit(self, scope: Scope) -> Access | None:
        """What the caller may see; None where anybody may pass. Takes a signed prefix off.

        Raises:
            UnauthorizedError: there is no token, or it is unknown or expired.
            ForbiddenError: the token or the signed address does not cover this.
        """
        path: str = scope["path"]
        if path in _OPEN_PATHS:
            return None
        if path.startswith(_SIGNED):
            return self._admit_signed(path, scope)
        token = self._token_of(scope)
        match = _VOLUME.match(path)
        allowed = token.allows_all or path == _LIST
        if not allowed and match is not None:
            allowed = token.allows(match[1] or match[2])
        if not allowed:
            raise ForbiddenError(f"The token {token.name!r} does not cover this address")
        return Access(token.name, token.allows)

    def _admit_signed(self, path: str, scope: Scope) -> Access:
        prefix = parse_prefix(path)
        match = None if prefix is None else _VOLUME.match(path, prefix.length)
        volume_id = "" if match is None else match[1] or match[2]
        if prefix is None or not volume_id or not is_signed(prefix, volume_id, self._keys()):
            raise ForbiddenError("The signature of this address is not good for it")
        if prefix.expires_unix <= self._now():
            raise ForbiddenError(
                "The signed address has expired; ask for a new one", expired=prefix.expires_unix
            )
        scope["path"] = path[prefix.length :]
        # The prefix holds nothing that is ever percent-encoded, so it has this length there too.
        scope["raw_path"] = (scope.get("raw_path") or path.encode())[prefix.length :]
        return Access("signed", volume_id.__eq__, prefix.expires_unix, prefix=path[: prefix.length])

    def _token_of(self, scope: Scope) -> Token:
        secret = bearer_secret(scope)
        if secret is None:
            raise UnauthorizedError(
                "This server wants a token: send it as 'Authorization: Bearer TOKEN'"
            )
        token = find_token(self._tokens(), secret)
        if token is None:
            raise UnauthorizedError("The token is not known here")
        if token.expires_unix is not None and token.expires_unix <= self._now():
            raise UnauthorizedError("The token has expired; ask for a new one")
        return token


def guard_of(settings: Settings) -> Guard | None:
    """The guard that the settings ask for; None where everybody may see everything.

    Raises:
        InvalidInputError: a file of tokens or keys is not sound, or can be changed or read by
            others on the machine.
        ResourceError: it cannot be read.
    """
    tokens: Callable[[], tuple[Token, ...]] = tuple
    keys: Callable[[], tuple[bytes, ...]] = tuple
    if settings.signing_key is not None and settings.signing_key_file is not None:
        raise InvalidInputError("set signing_key or signing_key_file, not both")
    if settings.tokens_file is not None:
        # Hashes of random secrets may be read by anybody; adding one opens the door.
        tokens = WatchedFile(settings.tokens_file, parse_tokens, stat.S_IWOTH).value
    if settings.signing_key is not None:
        fixed = parse_keys(settings.signing_key.get_secret_value(), "setting signing_key")
        keys = lambda: fixed  # noqa: E731
    if settings.signing_key_file is not None:
        where = str(settings.signing_key_file)
        file = WatchedFile(
            settings.signing_key_file,
            lambda text: parse_keys(text, where),
            stat.S_IROTH | stat.S_IWOTH,
        )
        keys = file.value
    if tokens is tuple and keys is tuple:
        return None
    return Guard(tokens, keys)


def bearer_secret(scope: Scope) -> bytes | None:
    """The token of an ``Authorization: Bearer`` header (RFC 6750); None where there is none."""
    for name, value in scope["headers"]:
        if name == b"authorization":
            scheme, _, secret = value.partition(b" ")
            return secret.strip() if scheme.lower() == b"bearer" else None
    return None
