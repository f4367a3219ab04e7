"""Where a source is: a path of this machine, or an address on a server."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlsplit

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import UnsupportedSourceError

SCHEMES = ("http", "https", "s3")

_URL = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")


@dataclass(frozen=True, slots=True)
class Url:
    """An address of one of `SCHEMES`; as text it is what was given, but for what is secret.

    Attributes:
        text: the address as it was given, with any name, password and query in it.
        scheme: in lower case.
        host: the server, with the port where there is one; of ``s3`` the bucket.
        key: the path on it, without slashes at its ends, decoded.
    """

    text: str
    scheme: str
    host: str
    key: str

    def __str__(self) -> str:
        return re.sub(r"[?#].*", "", self.address, flags=re.DOTALL)

    @property
    def address(self) -> str:
        """The address without a name and password."""
        return re.sub(r"(?<=://)[^/?#]*@", "", self.text)

    @property
    def login(self) -> tuple[str, str] | None:
        """The name and password in it, decoded."""
        parts = urlsplit(self.text)
        if parts.username is None:
            return None
        return unquote(parts.username), unquote(parts.password or "")

    @property
    def name(self) -> str:
        """The last part of the path, as the name of a file is; without a path the host."""
        return self.key.rsplit("/", 1)[-1] or self.host


# Both have a ``name`` and are, as text, what messages call a source.
Location = Path | Url


def is_url(path: str | os.PathLike[str]) -> bool:
    """Whether something is named as an address is, of whatever scheme."""
    return isinstance(path, str) and _URL.match(path) is not None


def location_of(path: str | os.PathLike[str]) -> Location:
    """The location that a caller names.

    Raises:
        InvalidInputError: an address without a server, or that is none.
        UnsupportedSourceError: an address of a scheme that is not read.
    """
    if not isinstance(path, str) or (match := _URL.match(path)) is None:
        return Path(path)
    scheme = match[1].lower()
    if scheme not in SCHEMES:
        raise UnsupportedSourceError(
            f"{match[0]}… is not read; addresses begin with "
            f"{', '.join(f'{known}://' for known in SCHEMES)}, files are named by their path",
            scheme=scheme,
        )
    try:
        parts = urlsplit(path)
        port = parts.port
    except ValueError as error:
        raise InvalidInputError(f"{scheme}://…: is no address: {error}; correct it") from error
    if not parts.hostname or not path.isprintable():
        raise InvalidInputError(
            f"{scheme}://…: no server is named; give an address such as https://host/volume.zarr "
            "or s3://bucket/volume.zarr"
        )
    host = parts.hostname if port is None else f"{parts.hostname}:{port}"
    if scheme == "s3":
        host = parts.netloc  # buckets are not lowered
    return Url(path, scheme, host, unquote(parts.path).strip("/"))
