"""Runs an image's root as a strict container would, and asks its service for a picture."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from containerfile import Instruction

START_LIMIT_SECONDS = 60.0
STOP_LIMIT_SECONDS = 30.0

# Asked from inside, where the service is; whether it is healthy the image's own check says.
QUESTIONS = """
import io, json, os
from urllib.request import urlopen
base = f"http://127.0.0.1:{os.environ['OCTOBRICK_PORT']}/v1/volumes"
(volume,) = json.load(urlopen(base))["volumes"]
detail = json.load(urlopen(f"{base}/{volume['id']}"))
picture = urlopen(f"{base}/{volume['id']}/render?width=320&height=240", timeout=120)
body = picture.read()
from PIL import Image
pixels = Image.open(io.BytesIO(body)).convert("L")
print(json.dumps({"id": volume["id"], "shape_zyx": detail["levels"][0]["shape_zyx"],
    "png_nbytes": len(body), "size": pixels.size, "grey_levels": len(set(pixels.tobytes())),
    "converged": picture.headers["X-Octobrick-Converged"]}))
"""


class Container:
    """A root file system, run as the image's user: read-only, no capabilities, no network.

    Args:
        root: the image's root; this process must be in a mount namespace of its own.
        environment: the image's ENV.
        user: ``UID:GID``.
        data_dir: mounted at /data.
    """

    def __init__(self, root: Path, environment: dict[str, str], user: str, data_dir: Path) -> None:
        self._root = root
        self._environment = environment
        uid, _, gid = user.partition(":")
        if not (uid.isdigit() and gid.isdigit() and int(uid) and int(gid)):
            raise SystemExit(f"USER {user}: must be the numbers of a user and group, not root's")
        self._rights = [f"--reuid={uid}", f"--regid={gid}", "--clear-groups", "--no-new-privs"]
        self._rights += ["--bounding-set=-all", "--inh-caps=-all"]
        mount("--bind", root, root)
        for kind, place in (("proc", "proc"), ("tmpfs", "tmp"), ("tmpfs", "dev")):
            mount("-t", kind, kind, root / place)
        for device in ("null", "zero", "urandom", "random"):
            (root / "dev" / device).touch()
            mount("--bind", Path("/dev") / device, root / "dev" / device)
        (root / "dev/shm").mkdir()
        mount("-t", "tmpfs", "-o", "size=64m,mode=1777", "shm", root / "dev/shm")
        (root / "tmp").chmod(0o1777)
        mount("--bind", data_dir, root / "data")
        mount("-o", "remount,bind,ro", root)

    def start(self, words: list[str]) -> subprocess.Popen[bytes]:
        """Start a command inside, in a network of its own, which has a loopback alone."""
        inside = ["unshare", "--net", "sh", "-c", 'ip link set lo up; exec "$@"', "sh"]
        return subprocess.Popen([*inside, *self._chroot(words)], env=self._environment_outside())

    def beside(self, process: subprocess.Popen[bytes], words: list[str]) -> bytes:
        """What a command says that runs in the network of one that was started."""
        command = ["nsenter", f"--net=/proc/{process.pid}/ns/net", *self._chroot(words)]
        done = subprocess.run(
            command, check=True, stdout=subprocess.PIPE, env=self._environment_outside()
        )
        return done.stdout

    def _chroot(self, words: list[str]) -> list[str]:
        # chroot needs a right that the user must not have: it comes first, setpriv is the image's.
        path = self._environment["PATH"]
        inner = ["/usr/bin/env", f"PATH={path}", "/usr/bin/setpriv", *self._rights, "--", *words]
        return ["chroot", str(self._root), *inner]

    def _environment_outside(self) -> dict[str, str]:
        return {**self._environment, "PATH": "/usr/sbin:/usr/bin:/sbin:/bin"}


def mount(*arguments: object) -> None:
    """Mount something, for as long as this process lives."""
    subprocess.run(["mount", *map(str, arguments)], check=True)


def serve_and_ask(
    root: Path, environment: dict[str, str], last: dict[str, Instruction], checkout: Path
) -> None:
    """Ingest a volume with an image, serve it, and prove that a picture comes.

    Raises:
        SystemExit: something did not go as it must, with a line that says what.
    """
    user = last["USER"].text
    entry, arguments = last["ENTRYPOINT"].words(), last["CMD"].words()
    check = last["HEALTHCHECK"]
    check_words = json.loads(check.text[check.text.index("CMD") + len("CMD") :])
    data_dir = root.parent / "data"
    data_dir.mkdir(exist_ok=True)
    subprocess.run(["chown", user, str(data_dir)], check=True)
    for name in ("ct_vhf_head.mhd", "ct_vhf_head.zraw"):
        subprocess.run(["cp", str(checkout / "data" / name), str(data_dir)], check=True)
    container = Container(root, environment, user, data_dir)
    ingest = container.start([*entry, "ingest", "/data/ct_vhf_head.mhd", "/data/head.zarr"])
    if ingest.wait() != 0:
        raise SystemExit(f"ingest in the image ended with {ingest.returncode}")
    mount("-o", "remount,bind,ro", root / "data")
    service = container.start([*entry, *arguments])
    try:
        wait_until_healthy(container, service, check_words)
        answer = json.loads(container.beside(service, ["python", "-c", QUESTIONS]))
        status = Path(f"/proc/{service.pid}/status").read_text(encoding="ascii")
        facts = dict(line.split(":\t", 1) for line in status.splitlines())
        print(json.dumps(answer))
        print(f"user {facts['Uid'].split()[1]}, capabilities {facts['CapEff'].strip()}")
        if facts["Uid"].split() != [user.partition(":")[0]] * 4 or int(facts["CapEff"], 16):
            raise SystemExit("the service does not run as the image's user, without rights")
        if answer["grey_levels"] < 16:
            raise SystemExit("the picture shows nothing")
    finally:
        service.send_signal(signal.SIGTERM)
        code = service.wait(STOP_LIMIT_SECONDS)
    if code != 0:
        raise SystemExit(f"the service ended with {code} after SIGTERM, not with 0")
    print("healthy, a picture over HTTP, stopped with status 0")


def wait_until_healthy(
    container: Container, service: subprocess.Popen[bytes], check: list[str]
) -> None:
    """Run the image's health check until it succeeds."""
    limit = time.monotonic() + START_LIMIT_SECONDS
    while True:
        if service.poll() is not None:
            raise SystemExit(f"the service ended with {service.returncode} while it started")
        try:
            container.beside(service, check)
        except subprocess.CalledProcessError:
            if time.monotonic() > limit:
                raise SystemExit("the health check does not succeed") from None
            time.sleep(0.5)
        else:
            print("the health check succeeds", file=sys.stderr)
            return
