"""Two network namespaces with a slow link between them, gone when the block ends.

The link is a program, `_link_forwarder.py`: kernels without netem cannot delay packets themselves.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import TracebackType

HERE = Path(__file__).resolve().parent
DEVICE = "slow0"


class ShapedLink:
    """A link between two namespaces, shaped in both directions. Needs root.

    Args:
        mbit: capacity in each direction.
        round_trip_ms: delay there and back.
    """

    server_address = "10.231.77.1"
    client_address = "10.231.77.2"

    def __init__(self, mbit: float, round_trip_ms: float) -> None:
        self._shape = [str(mbit), str(round_trip_ms / 2)]
        self._names = [f"obk{os.getpid()}{end}" for end in "sc"]
        self._forwarder: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> ShapedLink:
        try:
            self._make()
        except BaseException:
            self._remove()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._remove()

    def at_server(self, command: list[str]) -> list[str]:
        """A command, run at the server's end."""
        return ["ip", "netns", "exec", self._names[0], *command]

    def at_client(self, command: list[str]) -> list[str]:
        """A command, run at the client's end."""
        return ["ip", "netns", "exec", self._names[1], *command]

    def _make(self) -> None:
        for name in self._names:
            _run(f"ip netns add {name}")
            _run(f"ip -n {name} link set lo up")
        command = [sys.executable, str(HERE / "_link_forwarder.py"), *self._names, *self._shape]
        self._forwarder = subprocess.Popen(command, stdout=subprocess.PIPE)
        assert self._forwarder.stdout
        if self._forwarder.stdout.readline() != b"ready\n":
            raise RuntimeError("the link did not come up")
        for name, address in zip(
            self._names, (self.server_address, self.client_address), strict=True
        ):
            _run(f"ip -n {name} addr add {address}/24 dev {DEVICE}")
            _run(f"ip -n {name} link set {DEVICE} up")

    def _remove(self) -> None:
        if self._forwarder is not None:
            self._forwarder.terminate()
            self._forwarder.communicate()
        for name in self._names:
            _run(f"ip netns del {name}", check=False)


def received_nbytes() -> int:
    """What came over the link to this process's end, with the headers of its packets."""
    for line in Path("/proc/net/dev").read_text(encoding="ascii").splitlines():
        if line.strip().startswith(f"{DEVICE}:"):
            return int(line.split(":")[1].split()[0])
    raise RuntimeError(f"there is no {DEVICE} here")


def _run(command: str, *, check: bool = True) -> None:
    try:
        subprocess.run(command.split(), check=check, capture_output=True, text=True)
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"{command}: {error.stderr.strip()}") from error
