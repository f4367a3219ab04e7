"""``octobrick serve``: volumes, bricks and pictures over HTTP."""

from __future__ import annotations

import signal
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from octobrick.codec.errors import InvalidInputError, ResourceError

if TYPE_CHECKING:
    from octobrick.server.settings import Settings

_LOG_LEVELS = ["debug", "info", "warning", "error"]


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
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"]) or "data_dir"
        raise InvalidInputError(
            f"setting {name}: {first['msg']}, not {first['input']!r}", setting=name
        ) from error


def _serve(settings: Settings) -> None:
    try:
        import uvicorn

        from octobrick.server.app import create_app
    except ImportError as error:
        raise _missing_extra(error) from error
    listener = _listen(settings.host, settings.port)
    host, port = listener.getsockname()[:2]
    address = f"http://{f'[{host}]' if ':' in host else host}:{port}"

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            click.echo(f"octobrick serves {settings.data_dir or 'volumes'} at {address}")

    config = uvicorn.Config(
        create_app(settings),
        access_log=settings.log_level == "debug",
        http="httptools",
        lifespan="on",
        log_config=_log_config(settings.log_level),
        loop="uvloop",
        server_header=False,
        timeout_graceful_shutdown=settings.shutdown_seconds,
        ws="none",
    )
    # uvicorn hands a signal on once it has stopped; the default action would be to die of it.
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    with listener:
        Server(config).run(sockets=[listener])


def _listen(host: str, port: int) -> socket.socket:
    """A listening socket, made before anything else, so that its port is known and is ours."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, backlog=2048)
    except OSError as error:
        raise ResourceError(
            f"cannot listen on {host} port {port}: {error.strerror or error}; choose another "
            "address with --host and --port",
            host=host,
            port=port,
        ) from error


def _log_config(level: str) -> dict[str, Any]:
    """Everything to stderr; stdout has the address and nothing else."""
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "formatters": {"line": {"format": "%(asctime)s %(levelname)s %(name)s: %(message)s"}},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "line"}},
        "root": {"level": "WARNING", "handlers": ["stderr"]},
        "loggers": {name: {"level": level.upper()} for name in ("octobrick", "uvicorn")},
    }


def _missing_extra(error: ImportError) -> ResourceError:
    return ResourceError(
        f"the server needs a package that is not installed ({error.name}): "
        "pip install 'octobrick[server]'",
        package=error.name or "",
    )
