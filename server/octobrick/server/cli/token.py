"""``octobrick token``: a new bearer token, shown once."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta

import click

from octobrick.server.cli.durations import Duration
from octobrick.server.security.tokens import new_secret, token_entry


@click.command()
@click.argument("name")
@click.option(
    "--volumes",
    multiple=True,
    default=("*",),
    help="Ids that the token may see, as a pattern such as 'head*'; several times for more.",
)
@click.option("--expires", type=Duration(), help="End of the token: 90s, 15m, 1h, 30d from now.")
def token(name: str, volumes: tuple[str, ...], expires: int | None) -> None:
    """Make a token for the caller NAME.

    Prints the token, which is kept nowhere, and the entry for the tokens file of the server
    (setting tokens_file), which holds only its hash.
    """
    secret = new_secret()
    end = None if expires is None else datetime.now(UTC) + timedelta(seconds=expires)
    entry = token_entry(name, secret, volumes, end)
    click.echo(secret)
    click.echo(json.dumps(entry))
