"""``octobrick sign``: an address that lets its holder use one volume for a while."""

from __future__ import annotations

import os
import re
import time
from pathlib import Path

import click

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.server.cli.durations import Duration
from octobrick.server.security.signed_paths import parse_keys, signed_prefix

_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}")
_BASE = re.compile(rf"/(?:v1/volumes|zarr2?|precomputed)/({_ID.pattern})(?=[/?@]|\Z)")
_KEY = "OCTOBRICK_SIGNING_KEY"


@click.command()
@click.argument("address")
@click.option("--expires", type=Duration(), default="1h", help="End: 90s, 15m, 1h, 30d from now.")
@click.option(
    "--key-file",
    envvar=f"{_KEY}_FILE",
    type=click.Path(path_type=Path),
    help=f"The server's signing_key_file; or the key itself in {_KEY}.",
)
def sign(address: str, expires: int, key_file: Path | None) -> None:
    """Sign ADDRESS, which names a volume of a server: a whole address, its path, or the id.

    Prints the address that gives this volume to whoever has it, until it expires. What follows
    the volume's id may be left out, added and changed: the signature is for the whole volume.
    """
    key = _keys(key_file)[0]
    if _ID.fullmatch(address):
        address = f"/v1/volumes/{address}"
    match = _BASE.search(address)
    if match is None or "/signed/" in address:
        raise InvalidInputError(
            f"{address:.200}: must be a volume's id, or an address with /v1/volumes/ID, /zarr/ID, "
            "/zarr2/ID or /precomputed/ID in it"
        )
    prefix = signed_prefix(key, match[1], int(time.time()) + expires)
    click.echo(address[: match.start()] + prefix + address[match.start() :])


def _keys(key_file: Path | None) -> tuple[bytes, ...]:
    if key_file is not None:
        try:
            return parse_keys(key_file.read_text(), str(key_file))
        except (OSError, UnicodeDecodeError) as error:
            raise ResourceError(f"{key_file}: cannot be read ({error})") from error
    if _KEY in os.environ:
        return parse_keys(os.environ[_KEY], _KEY)
    raise InvalidInputError(f"no key: name the server's key file with --key-file, or set {_KEY}")
