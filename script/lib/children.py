"""Child processes that cannot outlive their parent, whatever ends it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from types import TracebackType
from typing import IO

# Importing the server takes about a second; a busy machine is much slower.
START_LIMIT_SECONDS = 60.0
STOP_LIMIT_SECONDS = 15.0

OCTOBRICK = Path(sys.executable).with_name("octobrick")  # the command, from the same environment

_ADDRESS = re.compile(rb"http://127\.0\.0\.1:[1-9][0-9]*")


def spawn(
    arguments: list[str], *, output: int | IO[bytes] | None = None
) -> subprocess.Popen[bytes]:
    """Start ``octobrick ARGUMENTS``; its stdout and stderr go to ``output``, or where ours go."""
    command = [str(OCTOBRICK), *arguments]
    # `finally` stops a child however Python leaves; where Python is killed, the kernel does.
    if (setpriv := shutil.which("setpriv")) is not None:
        command = [setpriv, "--pdeathsig", "TERM", *command]
    errors = None if output is None else subprocess.STDOUT
    return subprocess.Popen(command, stdout=output, stderr=errors)


def stop(process: subprocess.Popen[bytes]) -> None:
    """Ask a child to end, wait, and only then kill it."""
    process.terminate()
    try:
        process.wait(STOP_LIMIT_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def run(arguments: list[str]) -> int:
    """Run ``octobrick ARGUMENTS`` to its end; returns its exit status."""
    process = spawn(arguments)
    try:
        return process.wait()
    except KeyboardInterrupt:
        # The terminal has told the child too: let it tidy up, a second signal would cut that short.
        try:
            process.wait(STOP_LIMIT_SECONDS)
        except subprocess.TimeoutExpired:
            stop(process)
        raise
    except BaseException:
        stop(process)
        raise


class ServerProcess:
    """Serves a folder of volumes on a free loopback port while the ``with`` block runs.

    Args:
        folder: holds the volumes, each a ``NAME.zarr``.
        log: gets everything that the server prints.

    Raises:
        RuntimeError: on entry, where the server does not come up.
    """

    def __init__(self, folder: Path, log: Path) -> None:
        self.arguments = ["serve", str(folder), "--port", "0"]
        self.url = ""  # where it listens, without a slash at the end
        self._log = log
        self._url_is_known = threading.Event()

    def __enter__(self) -> ServerProcess:
        self._process = spawn(self.arguments, output=subprocess.PIPE)
        self._follower = threading.Thread(target=self._follow, daemon=True)
        self._follower.start()
        try:
            self._url_is_known.wait(START_LIMIT_SECONDS)
            if not self.url:
                raise RuntimeError(
                    f"octobrick serve did not come up within {START_LIMIT_SECONDS:g} s. "
                    f"It said: {self._log.read_text(errors='replace').strip() or 'nothing'}"
                )
        except BaseException:
            stop(self._process)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        stop(self._process)
        self._follower.join()

    @property
    def pid(self) -> int:
        """The server's process; its workers are below."""
        return self._process.pid

    def wait(self) -> int:
        """Until the server ends by itself; returns its exit status."""
        return self._process.wait()

    def _follow(self) -> None:
        """Copy what the server prints to the log, and look for the address in it."""
        assert self._process.stdout is not None
        with self._log.open("wb", buffering=0) as log, self._process.stdout as lines:
            for line in lines:
                log.write(line)
                found = _ADDRESS.search(line)
                if found is not None and not self.url:
                    self.url = found[0].decode()
                    self._url_is_known.set()
        self._url_is_known.set()  # the server has ended: whoever waits need not any longer
