"""``octobrick serve``: volumes, bricks and pictures over HTTP."""

from __future__ import annotations

import contextlib
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.codec.errors import InvalidInputError, ResourceError
from octobrick.server.cli.failure import EXIT_FAILED

if TYPE_CHECKING:
    from pydantic import ValidationError

    from octobrick.server.settings import Settings

_LOG_LEVELS = ["debug", "info", "warning", "error"]
_SECRETS = frozenset({"signing_key", "metrics_token"})  # never in a message


@click.command()
@click.argument(
    "data_dir",
    metavar="[DIR]",
    envvar="OCTOBRICK_DATA_DIR",
    type=click.Path(path_type=Path),
    required=False,
)
@click.option("--host", help="Address to listen on.  [default: 127.0.0.1]")
@click.option("--port", type=int, help="TCP port; 0 takes a free one.  [default: 8000]")
@click.option("--workers", type=int, help="Processes that share the port.  [default: 1]")
@click.option("--log-level", type=click.Choice(_LOG_LEVELS), help="[default: info]")
def serve(data_dir: Path | None, **given: Any) -> None:
    """Serve the volumes DIR/*.zarr over HTTP until SIGTERM or Ctrl-C.

    DIR may be left out where OCTOBRICK_VOLUMES lists volumes.

    Once requests are answered, one line with the address is printed. Everything else is a setting
    in the environment (OCTOBRICK_…, see docs/settings.md); options go before them.
    """
    if data_dir is not None and not data_dir.is_dir():
        raise InvalidInputError(
            f"{data_dir}: no such folder; name the folder that holds the *.zarr volumes",
            path=str(data_dir),
        )
    options = {name: value for name, value in given.items() if value is not None}
    _serve(_settings(data_dir, options))


def _settings(data_dir: Path | None, given: dict[str, Any]) -> Settings:
    try:
        from pydantic import ValidationError

        from octobrick.server.settings import Settings
    except ImportError as error:
        raise _missing_extra(error) from error
    try:
        return Settings(data_dir=data_dir, **given)
    except ValidationError as error:
        raise _wrong_setting(error) from error


def _wrong_setting(error: ValidationError) -> InvalidInputError:
    first = error.errors()[0]
    name = ".".join(str(part) for part in first["loc"]) or "data_dir"
    value = "" if name in _SECRETS else f", not {first['input']!r}"
    return InvalidInputError(f"setting {name}: {first['msg']}{value}", setting=name)


def _serve(settings: Settings) -> None:
    try:
        from octobrick.server.operations.log_format import log_config
        from octobrick.server.operations.server_process import ServerProcess, listen
        from octobrick.server.operations.supervisor import Supervisor
        from octobrick.server.security.guard import guard_of
    except ImportError as error:
        raise _missing_extra(error) from error
    guard_of(settings)  # what is wrong with its files is told here, in one line
    _allow_descriptors()
    try:
        listener = listen(settings)
    except OSError as error:
        raise ResourceError(
            f"cannot listen on {settings.host} port {settings.port}: {error.strerror or error}; "
            "choose another address with --host and --port",
            host=settings.host,
            port=settings.port,
        ) from error
    host, port = listener.getsockname()[:2]
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}"

    def announce() -> None:
        click.echo(f"octobrick serves {settings.data_dir or 'volumes'} at {address}")

    with listener:
        if settings.workers > 1:
            import logging.config

            logging.config.dictConfig(log_config(settings.log_level, settings.log_format))
            status = Supervisor(settings, listener, announce).run()
        else:
            server = ServerProcess(settings, announce)
            server.run(sockets=[listener])
            status = 0 if server.started else EXIT_FAILED
    if status:
        sys.exit(status)


def _allow_descriptors() -> None:
    """Take as many descriptors as the system lets: connections and shards need one each."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < hard:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def _missing_extra(error: ImportError) -> ResourceError:
    return ResourceError(
        f"the server needs a package that is not installed ({error.name}): "
        "pip install 'octobrick[server]'",
        package=error.name or "",
    )
