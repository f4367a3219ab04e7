"""The pool of render processes: crashes, hangs, turns, cancellation and ends. Needs no OpenGL."""

from __future__ import annotations

import logging
import os
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from octobrick.codec.errors import CorruptBrickError
from octobrick.server.errors import (
    BusyError,
    InternalError,
    RenderCrashedError,
    RenderingOffError,
    RenderTimeoutError,
)
from octobrick.server.pictures.fair_queue import FairQueue
from octobrick.server.pictures.render_job import RenderJob
from octobrick.server.pictures.render_pool import RenderPool, _pause_seconds
from octobrick.server.pictures.render_task import RenderTask
from octobrick.server.pictures.worker_process import ProcessWorker

STAND_IN = str(Path(__file__).with_name("stand_in_worker.py"))
COMMAND = [sys.executable, STAND_IN, "{fd}"]
PAYLOAD_MAX_NBYTES = 1000
WAIT_SECONDS = 20  # only a failing test waits as long

MakePool = Callable[..., RenderPool]


def task(do: str, argument: Any = None) -> RenderTask:
    return RenderTask("head.zarr", None, "r", {"do": do, "argument": argument})


class Asked:
    """A job and what was delivered of it."""

    def __init__(self, pool: RenderPool, do: str, argument: Any = None, client: str = "a") -> None:
        self.events: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.job = pool.submit(task(do, argument), client, self.events.put)

    def next(self) -> Any:
        return self.events.get(timeout=WAIT_SECONDS)

    def pid(self) -> int:
        """Of the process that made the one part."""
        part = self.next()
        assert not isinstance(part, Exception), part
        assert self.next() is None
        return int(part.body)


def started_pool(
    *arguments: str, memory_limit_nbytes: int | None = None, **options: Any
) -> RenderPool:
    def worker() -> ProcessWorker:
        return ProcessWorker([*COMMAND, *arguments], PAYLOAD_MAX_NBYTES, memory_limit_nbytes)

    given = {"nworkers": 1, "queue_length": 100, "queue_per_client": 50, "limit_seconds": 60}
    pool = RenderPool(worker, **(given | options))
    pool.start()
    return pool


@pytest.fixture(scope="module")
def pool() -> Iterator[RenderPool]:
    """One that many tests use, whatever the others did to its worker."""
    pool = started_pool()
    yield pool
    pool.close(0)


@pytest.fixture
def make_pool() -> Iterator[MakePool]:
    pools = []

    def make(*arguments: str, **options: Any) -> RenderPool:
        pools.append(started_pool(*arguments, **options))
        return pools[-1]

    yield make
    for pool in pools:
        pool.close(0)


def is_alive(pid: int) -> bool:
    """Whether any thread of a process is."""
    try:
        states = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/stat")]
    except OSError:
        return False
    return any(state.rsplit(")", 1)[1].split()[0] not in "ZX" for state in states)


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_SECONDS
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_one_process_makes_picture_after_picture_and_tells_what_it_holds(
    pool: RenderPool,
) -> None:
    first = Asked(pool, "picture").pid()
    assert first != os.getpid()
    assert Asked(pool, "picture").pid() == first
    wait_until(lambda: pool.stats()["running"] == 0)
    stats = pool.stats()
    assert (stats["rendered_total"], stats["slab_nbytes"], stats["bricks_nbytes"]) == (2, 7, 0)
    assert stats["render_seconds_total"] > 0


@pytest.mark.parametrize("name", ["SIGSEGV", "SIGKILL"])
def test_a_crash_costs_its_own_picture_alone_and_the_next_has_a_fresh_process(
    pool: RenderPool, name: str
) -> None:
    first = Asked(pool, "picture").pid()
    before = pool.stats()["crashed_total"]
    crashed, waiting = Asked(pool, "die", name), Asked(pool, "picture")
    error = crashed.next()
    assert isinstance(error, RenderCrashedError)
    assert error.facts == {"how": name}
    assert waiting.pid() != first
    assert not is_alive(first)
    assert pool.stats()["crashed_total"] == before + 1


def test_a_worker_that_died_between_pictures_costs_none(pool: RenderPool) -> None:
    first = Asked(pool, "picture").pid()
    os.kill(first, signal.SIGKILL)
    wait_until(lambda: not is_alive(first))
    assert Asked(pool, "picture").pid() != first


def test_a_hang_is_a_timeout_and_its_process_is_gone() -> None:
    workers = []

    def worker() -> ProcessWorker:
        workers.append(ProcessWorker(COMMAND, PAYLOAD_MAX_NBYTES))
        return workers[-1]

    pool = RenderPool(worker, nworkers=1, queue_length=9, queue_per_client=9, limit_seconds=0.5)
    pool.start()
    try:
        error = Asked(pool, "hang").next()
        assert isinstance(error, RenderTimeoutError)
        assert error.facts["limit"] == 0.5
        assert not is_alive(workers[0].pid)
        assert pool.stats()["timed_out_total"] == 1
    finally:
        pool.close(0)


def test_a_worker_that_takes_too_much_memory_is_killed(make_pool: MakePool) -> None:
    pool = make_pool(memory_limit_nbytes=150 << 20)
    error = Asked(pool, "grow").next()
    assert isinstance(error, RenderCrashedError)
    assert "memory" in error.message
    assert Asked(pool, "picture").pid()


def test_an_unexpected_exception_is_internal_and_the_log_has_it(
    pool: RenderPool, caplog: pytest.LogCaptureFixture
) -> None:
    first = Asked(pool, "picture").pid()
    with caplog.at_level(logging.WARNING):
        assert isinstance(Asked(pool, "raise").next(), InternalError)
        wait_until(lambda: "nobody foresaw this" in caplog.text)
    assert Asked(pool, "picture").pid() == first


def test_an_error_travels_with_its_class_message_and_facts(pool: RenderPool) -> None:
    error = Asked(pool, "refuse").next()
    assert type(error) is CorruptBrickError
    assert error.message == "checksums differ in /this/file"
    assert error.facts == {"level": 3}


@pytest.mark.parametrize("do", ["long part", "evil part"])
def test_what_no_worker_would_send_is_not_believed(pool: RenderPool, do: str) -> None:
    if do == "long part":  # the other side may think that it may
        assert isinstance(Asked(pool, do).next(), InternalError)
    else:
        assert isinstance(Asked(pool, do).next(), RenderCrashedError)
    assert Asked(pool, "picture").pid()


def test_babble_instead_of_messages_is_a_crash(make_pool: MakePool) -> None:
    assert isinstance(Asked(make_pool("babbles"), "picture").next(), RenderCrashedError)


def test_workers_that_never_start_answer_with_pauses_and_their_words_are_logged(
    make_pool: MakePool, caplog: pytest.LogCaptureFixture
) -> None:
    pool = make_pool("broken")
    with caplog.at_level(logging.WARNING):
        for _ in range(3):
            error = Asked(pool, "picture").next()
            assert isinstance(error, RenderCrashedError)
            assert error.facts == {"how": "exit code 1"}
        wait_until(lambda: "no such library" in caplog.text)
    assert [_pause_seconds(n) for n in (0, 1, 2, 3, 100)] == [0, 0, 0.5, 1, 30]


def test_a_full_queue_refuses_and_what_waits_is_answered(
    make_pool: MakePool, tmp_path: Path
) -> None:
    pool = make_pool(queue_length=3, queue_per_client=2)
    running = Asked(pool, "hang", str(tmp_path / "begun"))
    wait_until((tmp_path / "begun").exists)
    waiting = [Asked(pool, "picture"), Asked(pool, "picture")]
    with pytest.raises(BusyError, match="2 of your pictures") as refused:
        Asked(pool, "picture")
    assert refused.value.facts["limit_name"] == "render_queue_per_client"
    waiting.append(Asked(pool, "picture", client="b"))
    with pytest.raises(BusyError, match="3 pictures wait") as refused:
        Asked(pool, "picture", client="c")
    assert refused.value.facts["limit_name"] == "render_queue_length"
    assert (pool.stats()["waiting"], pool.stats()["refused_total"]) == (3, 2)
    os.kill(int((tmp_path / "begun").read_text()), signal.SIGKILL)
    assert isinstance(running.next(), RenderCrashedError)
    assert all(asked.pid() for asked in waiting)


def test_clients_take_turns_each_in_its_own_order() -> None:
    waiting = FairQueue(10, 10)
    jobs = {
        name: RenderJob(task(name), name[0], lambda _: None)
        for name in ("a1", "a2", "a3", "a4", "b1", "b2", "c1")
    }
    for job in jobs.values():
        waiting.put(job)
    assert waiting.remove(jobs["a3"])
    assert not waiting.remove(jobs["a3"])
    order = [job.task.picture["do"] for job in iter(waiting.take, None)]
    assert order == ["a1", "b1", "c1", "a2", "b2", "a4"]
    assert len(waiting) == 0


def test_a_job_stopped_while_it_waits_is_not_begun(pool: RenderPool, tmp_path: Path) -> None:
    before = pool.stats()["stopped_total"]
    running = Asked(pool, "until stopped")
    assert running.next().body
    given_up = Asked(pool, "hang", str(tmp_path / "begun"))
    kept = Asked(pool, "picture")
    pool.stop(given_up.job)
    pool.stop(running.job)  # and a running one is told between its parts
    assert kept.pid()
    assert not (tmp_path / "begun").exists()
    assert running.events.empty()
    assert given_up.events.empty()
    assert pool.stats()["stopped_total"] == before + 2


def test_closing_answers_what_waits_and_kills_what_does_not_end(
    make_pool: MakePool, tmp_path: Path
) -> None:
    pool = make_pool()
    running = Asked(pool, "hang", str(tmp_path / "begun"))
    wait_until((tmp_path / "begun").exists)
    worker = int((tmp_path / "begun").read_text())
    waiting = Asked(pool, "picture")
    pool.close(0)
    assert isinstance(waiting.next(), BusyError)
    assert isinstance(running.next(), BusyError)
    assert not is_alive(worker)
    with pytest.raises(BusyError, match="shutting down"):
        Asked(pool, "picture")


def test_without_workers_pictures_are_refused_for_good(make_pool: MakePool) -> None:
    with pytest.raises(RenderingOffError):
        Asked(make_pool(nworkers=0), "picture")


PARENT = """
import sys, time
from octobrick.server.pictures.render_job import RenderJob
from octobrick.server.pictures.render_task import RenderTask
from octobrick.server.pictures.worker_process import ProcessWorker
worker = ProcessWorker([sys.executable, sys.argv[1], "{fd}"], 1000)
print(worker.pid, flush=True)
task = RenderTask("", None, "", {"do": "hang", "argument": sys.argv[2]})
worker.run(RenderJob(task, "a", print), 999)
"""


def test_a_worker_dies_with_its_parent_even_at_work(tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, STAND_IN, str(begun)], stdout=subprocess.PIPE, text=True
    )
    with parent:
        assert parent.stdout
        worker = int(parent.stdout.readline())
        wait_until(begun.exists)
        assert is_alive(worker)
        parent.kill()
    wait_until(lambda: not is_alive(worker))
