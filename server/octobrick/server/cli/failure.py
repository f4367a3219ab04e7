"""How a command fails: one line on stderr, an exit code, a traceback only on demand."""

from __future__ import annotations

import os
import sys
import traceback

import click

from octobrick.codec.errors import InvalidInputError, OctobrickError

EXIT_FAILED = 1  # the input is sound, but something is missing, damaged or in the way
EXIT_USAGE = 2  # another call is needed; also what shells use for wrong options
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells report it


def report_failure(error: BaseException, *, debug: bool) -> int:
    """Tell the user what went wrong; returns the exit code."""
    if debug:
        click.echo("".join(traceback.format_exception(error)), err=True, nl=False)
    match error:
        case click.exceptions.NoArgsIsHelpError():
            error.show()
            return EXIT_USAGE
        case KeyboardInterrupt() | click.Abort():
            click.echo("octobrick: interrupted", err=True)
            return EXIT_INTERRUPTED
        case click.UsageError():
            command = error.ctx.command_path if error.ctx else "octobrick"
            _say("invalid-input", f"{error.format_message()} See '{command} --help'.")
            return EXIT_USAGE
        case InvalidInputError():
            _say(error.kind, error.message)
            return EXIT_USAGE
        case OctobrickError():
            _say(error.kind, error.message)
            return EXIT_FAILED
        case BrokenPipeError():
            # Whoever read the output has enough, such as `| head`: no fault, and nobody to tell.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return EXIT_FAILED
        case OSError():
            _say("resource", str(error))
            return EXIT_FAILED
        case _:
            hint = "" if debug else "; 'octobrick --debug …' shows where"
            _say("internal", f"{type(error).__name__}: {error}{hint}")
            return EXIT_FAILED


def _say(kind: str, message: str) -> None:
    click.echo(f"octobrick: error [{kind}]: {' '.join(message.split())}", err=True)
