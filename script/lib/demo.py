"""The demo: a real volume from its file to compressed bricks, over HTTP, to pictures.

Run by ``script/demo``, whose help lists the options. It runs the commands that a user would type,
and checks what comes back instead of trusting it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import signal
import sys
import time
import urllib.parse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import children
from demo_checks import CheckError, check_bricks, check_picture, check_render, is_good

from octobrick.codec.errors import OctobrickError

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "data" / "ct_vhf_head.mhd"


@dataclass(frozen=True)
class View:
    """A picture to take: its file, and the rest in the words of command line and service."""

    name: str
    parameters: dict[str, str]


def views_of_the_head() -> Iterator[View]:
    """The bundled volume from near by, because there is much air around the head in it."""
    front = {"azimuth": "30", "elevation": "15"}
    side = {"azimuth": "90", "elevation": "10"}
    yield View("bone", {"preset": "ct-bone", **front, "distance": "620"})
    yield View("bone-side", {"preset": "ct-bone", **side, "distance": "620"})
    yield View("soft-tissue", {"preset": "ct-soft-tissue", **front, "distance": "700"})
    yield View("skin", {"preset": "ct-soft-tissue", "window": "10,70", **front, "distance": "700"})


def view_of(preset: str) -> View:
    """Any volume, all of it."""
    return View(preset, {"preset": preset, "azimuth": "30", "elevation": "15"})


class CommandError(Exception):
    """A command of the demo ended with a status other than 0; it has said why itself."""


def main() -> int:
    """Run all steps; 0 only where each did what it promises."""
    options = parse_arguments()
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _leave)
    start_seconds = time.monotonic()
    try:
        demonstrate(options)
    except (CheckError, CommandError, OctobrickError, OSError, RuntimeError) as error:
        print(f"\nThe demo failed: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nThe demo was stopped; nothing of it runs on.", file=sys.stderr)
        return 130  # 128 + SIGINT, as shells report it
    print(f"\nAll of it in {time.monotonic() - start_seconds:.1f} s.")
    return 0


def parse_arguments() -> argparse.Namespace:
    """The options; ``script/demo -h`` describes them."""
    parser = argparse.ArgumentParser(prog="script/demo", epilog="script/demo -h tells more")
    parser.add_argument("--serve", action="store_true")
    parser.add_argument("--fresh", action="store_true")
    parser.add_argument("--source", type=Path, default=SOURCE)
    parser.add_argument("--preset")
    parser.add_argument("--size", default="768x768")
    parser.add_argument("--out", type=Path, default=ROOT / "demo")
    return parser.parse_args()


def demonstrate(options: argparse.Namespace) -> None:
    """The steps, one after the other."""
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    if options.source == SOURCE and options.preset is None:
        name, views = "head", list(views_of_the_head())
    else:
        name, views = options.source.name.partition(".")[0], [view_of(options.preset or "ct-bone")]
    path = out / f"{name}.zarr"

    with step("Ingest: from a file to levels of compressed bricks"):
        if options.source == SOURCE:
            say(f"where it comes from: {short(SOURCE.with_name('README.md'))}")
        ingest(options.source, path, fresh=options.fresh)
    with step("Render: pictures of the compressed bricks, without a screen"):
        pictures = [render(path, view, options.size, out) for view in views]
    with contextlib.ExitStack() as stack:
        with step("Serve: the same over HTTP"):
            server = children.ServerProcess(out, out / "server.log")
            echo(server.arguments)
            stack.enter_context(server)
            say(f"at {server.url}, until the demo ends")
        with step("Fetch: what a client gets"):
            say(check_bricks(server.url, name, path, options.source))
            width, _, height = options.size.partition("x")
            query = {**views[0].parameters, "width": width, "height": height}
            say(check_render(server.url, name, query, out / "over-http.png", pictures[0]))
        print("\nLook at")
        for picture in pictures:
            say(short(picture))
        if options.serve:
            keep_serving(server, f"{server.url}/v1/volumes/{name}", query)


def ingest(source: Path, path: Path, *, fresh: bool) -> None:
    """Make the volume, unless a good one that is newer than its source is there."""
    if not fresh and path.exists():
        newer = (path / "zarr.json").is_file() and _mtime(path / "zarr.json") >= _mtime(source)
        if newer and is_good(path):
            say(f"{short(path)} is there and undamaged; --fresh makes it again")
            command("info", short(path))
            return
        say(f"{short(path)} is {'damaged' if newer else 'older than its source'}: making it again")
    command("ingest", short(source), short(path), *(["--overwrite"] if path.exists() else []))


def render(path: Path, view: View, size: str, out: Path) -> Path:
    """Take one picture with the command line; returns its file."""
    picture = out / f"{view.name}.png"
    words = [word for name, value in view.parameters.items() for word in (f"--{name}", value)]
    command("render", short(path), "-o", short(picture), *words, "--size", size)
    check_picture(picture)
    return picture


def keep_serving(server: children.ServerProcess, place: str, query: dict[str, str]) -> None:
    """Serve until Ctrl-C, which is the expected end and no failure."""
    print("\nOpen in a browser")
    say(f"{place}/render?{urllib.parse.urlencode(query)}")
    say(f"{place}")
    say(f"{server.url}/docs")
    try:
        print("Ctrl-C stops it.", flush=True)
        status = server.wait()
    except KeyboardInterrupt:
        return
    raise RuntimeError(f"the server ended by itself with {status}; see server.log")


@contextlib.contextmanager
def step(title: str) -> Iterator[None]:
    """A heading, what happens, and how long it took."""
    print(f"\n{title}", flush=True)
    start_seconds = time.monotonic()
    yield
    say(f"({time.monotonic() - start_seconds:.1f} s)")


def command(*arguments: str) -> None:
    """Show a command as a user would type it, and run it."""
    echo(list(arguments))
    status = children.run(list(arguments))
    if status != 0:
        raise CommandError(f"octobrick {arguments[0]} ended with {status}")


def echo(arguments: list[str]) -> None:
    """Show a command as a user would type it."""
    say(f"$ octobrick {shlex.join(map(short, arguments))}")


def say(text: str) -> None:
    """A line of a step; flushed, since the next one may come from a child."""
    print(f"  {text}", flush=True)


def short(path: str | Path) -> str:
    """A path below the current folder without that folder, to read and to type."""
    return str(path).removeprefix(f"{os.getcwd()}/")  # noqa: PTH109  (a prefix, not a path)


def _mtime(path: Path) -> float:
    return path.stat().st_mtime


def _leave(number: int, _frame: object) -> None:
    """Leave by an exception, so that every `finally` and `with` runs."""
    sys.exit(128 + number)


if __name__ == "__main__":
    sys.exit(main())
