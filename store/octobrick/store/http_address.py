"""The address of a volume on an octobrick server, and those of what it is made of."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import urlsplit

from octobrick.codec.errors import InvalidInputError
from octobrick.store.box import Zyx

_PATH = re.compile(
    r"((?:/[A-Za-z0-9._~=-]+)*)/v1/volumes/([A-Za-z0-9][A-Za-z0-9._-]{0,127})/?", re.ASCII
)
# What a signed address grants is in the address: messages and logs must not pass it on.
_SECRET = re.compile(r"/signed/[^/]+/[^/]+")


@dataclass(frozen=True, slots=True)
class VolumeAddress:
    """``http://host/v1/volumes/ID``; as text without what is secret in it.

    Attributes:
        origin: scheme, host and port: all that a connection needs.
        prefix: the path before ``/v1``, such as that of a proxy or of a signed address.
        volume_id: the volume's name on the server.
    """

    origin: str
    prefix: str
    volume_id: str

    def __str__(self) -> str:
        return self.shown(self.volume_path)

    def shown(self, path: str) -> str:
        """A path of this server as messages name it."""
        return self.origin + _SECRET.sub("/signed/…", path)

    @property
    def volume_path(self) -> str:
        """Of the metadata."""
        return f"{self.prefix}/v1/volumes/{self.volume_id}"

    @property
    def batch_path(self) -> str:
        """Of many bricks at once."""
        return f"{self.volume_path}/bricks"

    def attributes_path(self, revision: str) -> str:
        """Of all attributes."""
        return f"{self.volume_path}/{revision}/attributes"

    def table_path(self, revision: str, kind: str, level: int, t: int, c: int) -> str:
        """Of what is known per brick."""
        return f"{self.volume_path}/{revision}/tables/{kind}/{level}/{t}/{c}"

    def brick_path(self, revision: str, route: str, level: int, zyx: Zyx, t: int, c: int) -> str:
        """Of one brick; the route is ``bricks`` or ``gradients``."""
        z, y, x = zyx
        return f"{self.volume_path}/{revision}/{route}/{level}/{t}/{c}/{z}/{y}/{x}"


def is_volume_address(text: str) -> bool:
    """Whether an address looks like that of a volume on an octobrick server."""
    return re.match(r"https?://[^?#]*/v1/volumes/", text) is not None


def volume_address(text: str) -> VolumeAddress:
    """The address that a caller names.

    Raises:
        InvalidInputError: it is not ``http://`` or ``https://`` and ``/v1/volumes/ID`` at its end,
            or has a password in it.
    """
    try:
        parts = urlsplit(text)
        host, port, login = parts.hostname, parts.port, parts.username
    except ValueError as error:
        raise InvalidInputError(f"this is no address: {error}; correct it") from None
    if login is not None:
        raise InvalidInputError(
            "the address holds a name or password, which would be seen in messages; give a token "
            "by OCTOBRICK_TOKEN instead"
        )
    path = _PATH.fullmatch(parts.path)
    if parts.scheme not in ("http", "https") or not host or path is None or not text.isascii():
        raise InvalidInputError(
            f"{_SECRET.sub('/signed/…', text)!r:.200} is not the address of a volume; give one "
            "such as http://host:8000/v1/volumes/head"
        )
    if parts.query or parts.fragment:
        raise InvalidInputError(f"{path[0]!r:.80}: leave out what begins with ? or #")
    name = f"[{host}]" if ":" in host else host
    origin = f"{parts.scheme}://{name}" + (f":{port}" if port is not None else "")
    return VolumeAddress(origin, path[1], path[2])
