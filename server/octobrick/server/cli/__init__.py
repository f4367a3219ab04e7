"""The command line: one group, one file per command.

Nothing heavy is imported before a command runs, so that ``octobrick --help`` answers at once.
"""

from __future__ import annotations

import sys
from typing import Any

import click

from octobrick.server.cli.export import export
from octobrick.server.cli.failure import report_failure
from octobrick.server.cli.info import info
from octobrick.server.cli.ingest import ingest
from octobrick.server.cli.light_field import light_field
from octobrick.server.cli.measure import measure
from octobrick.server.cli.movie import movie
from octobrick.server.cli.render import render
from octobrick.server.cli.serve import serve
from octobrick.server.cli.sign import sign
from octobrick.server.cli.synth import synth
from octobrick.server.cli.token import token
from octobrick.server.cli.verify import verify

__all__ = ["main"]


class _Cli(click.Group):
    """A group whose failures are one line on stderr and an exit code, never a traceback."""

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run the command line and exit the process with its code."""
        extra["standalone_mode"] = False
        try:
            code = super().main(*args, **extra)
        except Exception as error:  # a wrong option of the group, before --debug is known
            code = report_failure(error, debug=False)
        sys.exit(code if isinstance(code, int) else 0)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the chosen command."""
        try:
            return super().invoke(ctx)
        except click.exceptions.Exit:
            raise
        except (Exception, KeyboardInterrupt) as error:
            ctx.exit(report_failure(error, debug=ctx.params["debug"]))


@click.group(cls=_Cli, context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.version_option(package_name="octobrick", message="octobrick %(version)s")
def main(debug: bool) -> None:
    """Volumes too big for memory: compress, look at and serve them."""


for _command in (
    ingest,
    info,
    measure,
    render,
    movie,
    light_field,
    serve,
    export,
    synth,
    verify,
    token,
    sign,
):
    main.add_command(_command)
