"""The packets of a slow link: taken from one namespace, given to the other, late and not too fast.

    _link_forwarder.py NAMESPACE NAMESPACE MBIT ONE_WAY_MS

Each direction sends packets one after the other, each for as long as the link needs for its bits,
holds a queue that a router of that speed would have and drops what does not fit; then the packet
travels. Ends with SIGTERM.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import select
import struct
import sys
import time
from collections import deque

DEVICE = b"slow0"
MTU_NBYTES = 1_500
QUEUE_SECONDS = 0.1  # more would only add delay, less would lose packets at once
# From linux/if_tun.h and sched.h.
TUNSETIFF, IFF_TUN, IFF_NO_PI, CLONE_NEWNET = 0x400454CA, 0x0001, 0x1000, 0x4000_0000


def open_tun(namespace: str) -> int:
    """A TUN device in a namespace; this process stays where it is."""
    libc = ctypes.CDLL(None, use_errno=True)
    here, there = (
        os.open(path, os.O_RDONLY) for path in ("/proc/self/ns/net", f"/run/netns/{namespace}")
    )
    try:
        if libc.setns(there, CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter {namespace}")
        device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
        fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH14x", DEVICE, IFF_TUN | IFF_NO_PI))
        if libc.setns(here, CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "cannot come back")
    finally:
        os.close(here)
        os.close(there)
    return device


class Direction:
    """Packets on their way from one end to the other."""

    def __init__(self, source: int, target: int, bits_per_second: float, seconds: float) -> None:
        self.source = source
        self._target, self._rate, self._delay = target, bits_per_second, seconds
        self._sent = 0.0  # when the last packet in the queue has left it
        self._travelling: deque[tuple[float, bytes]] = deque()

    def take(self, now: float) -> None:
        """All packets that the source has."""
        while True:
            try:
                packet = os.read(self.source, MTU_NBYTES)
            except BlockingIOError:
                return
            begin = max(now, self._sent)
            if begin - now > QUEUE_SECONDS:
                continue  # the queue is full: lost
            self._sent = begin + 8 * len(packet) / self._rate
            self._travelling.append((self._sent + self._delay, packet))

    def give(self, now: float) -> float:
        """What has arrived; returns the seconds until the next does."""
        while self._travelling and self._travelling[0][0] <= now:
            try:
                os.write(self._target, self._travelling.popleft()[1])
            except OSError:  # the other end is not up: lost
                continue
        return self._travelling[0][0] - now if self._travelling else 1.0


def main() -> None:
    """Forward until somebody ends it."""
    ends = [open_tun(name) for name in sys.argv[1:3]]
    mbit, one_way_ms = map(float, sys.argv[3:5])
    there, back = ends
    directions = [
        Direction(source, target, mbit * 1e6, one_way_ms / 1e3)
        for source, target in ((there, back), (back, there))
    ]
    print("ready", flush=True)
    wait = 1.0
    while True:
        select.select(ends, [], [], max(0.0, wait))
        now = time.monotonic()
        for direction in directions:
            direction.take(now)
        wait = min(direction.give(time.monotonic()) for direction in directions)


if __name__ == "__main__":
    main()
