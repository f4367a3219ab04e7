"""Two network namespaces with a slow link between them, gone when the block ends."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from types import TracebackType

# What a router keeps for a link: more only adds delay, less loses packets at once.
QUEUE_SECONDS = 0.1
BURST_NBYTES = 65_536  # one large packet of the kernel


class ShapedLink:
    """A veth pair between two namespaces, shaped at both ends. Needs root.

    Args:
        mbit: capacity in each direction.
        round_trip_ms: delay there and back.
    """

    server_address = "10.231.77.1"
    client_address = "10.231.77.2"

    def __init__(self, mbit: float, round_trip_ms: float) -> None:
        self._mbit, self._delay_ms = mbit, round_trip_ms / 2
        self._names = [f"obk{os.getpid()}{end}" for end in "sc"]

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
        server, client = self._names
        for name in self._names:
            _run(f"ip netns add {name}")
        _run(f"ip link add veth0 netns {server} type veth peer name veth0 netns {client}")
        for name, address in ((server, self.server_address), (client, self.client_address)):
            _run(f"ip -n {name} addr add {address}/24 dev veth0")
            _run(f"ip -n {name} link set lo up")
            _run(f"ip -n {name} link set veth0 up")
            self._shape(name)

    def _shape(self, name: str) -> None:
        """The capacity by a token bucket, whose child delays; packets as a real link has them."""
        _run(f"ip netns exec {name} ethtool -K veth0 tso off gso off", check=False)
        limit = int(self._mbit * 1e6 / 8 * QUEUE_SECONDS) + BURST_NBYTES
        root = f"tc -n {name} qdisc add dev veth0 root handle 1: tbf"
        _run(f"{root} rate {self._mbit}mbit burst {BURST_NBYTES} limit {limit}")
        child = f"tc -n {name} qdisc add dev veth0 parent 1:1 handle 10: netem"
        _run(f"{child} delay {self._delay_ms}ms limit 10000")

    def _remove(self) -> None:
        for name in self._names:
            _run(f"ip netns del {name}", check=False)


def received_nbytes() -> int:
    """What came over the link to this process's end, with all headers."""
    for line in Path("/proc/net/dev").read_text(encoding="ascii").splitlines():
        if line.strip().startswith("veth0:"):
            return int(line.split(":")[1].split()[0])
    raise RuntimeError("there is no veth0 here")


def _run(command: str, *, check: bool = True) -> None:
    try:
        subprocess.run(command.split(), check=check, capture_output=True, text=True)
    except FileNotFoundError:
        if check:
            raise
    except subprocess.CalledProcessError as error:
        raise RuntimeError(f"{command}: {error.stderr.strip()}") from error
