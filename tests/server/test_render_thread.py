"""The render thread: order, limits, failures and an orderly end."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future

import pytest

from octobrick.codec.errors import ResourceError
from octobrick.server.errors import BusyError
from octobrick.server.render_thread import RenderThread

WAIT_SECONDS = 10  # only a failing test waits as long


class Renderer:
    """Counts how many of it were made and closed, and in which thread."""

    def __init__(self, log: list[str]) -> None:
        self.log = log
        self.thread = threading.current_thread()
        log.append("made")

    def close(self) -> None:
        assert threading.current_thread() is self.thread
        self.log.append("closed")


@pytest.fixture
def log() -> list[str]:
    return []


@pytest.fixture
def renders(log: list[str]) -> Iterator[RenderThread[Renderer]]:
    thread = RenderThread(lambda: Renderer(log), queue_length=2)
    thread.start()
    yield thread
    thread.close(WAIT_SECONDS)


def occupy(renders: RenderThread[Renderer]) -> Callable[[], None]:
    """Keep the thread busy until the function that is returned is called."""
    started, finish = threading.Event(), threading.Event()

    def job(_: Renderer) -> None:
        started.set()
        assert finish.wait(WAIT_SECONDS)

    renders.submit(job)
    assert started.wait(WAIT_SECONDS)
    return finish.set


def test_jobs_run_in_order_with_one_renderer_that_is_made_on_demand(
    renders: RenderThread[Renderer], log: list[str]
) -> None:
    assert log == []
    finish = occupy(renders)
    order: list[int] = []
    first = renders.submit(lambda _: order.append(0))
    second = renders.submit(lambda _: order.append(1))
    finish()
    first.result(WAIT_SECONDS)
    second.result(WAIT_SECONDS)
    assert order == [0, 1]
    renders.close(WAIT_SECONDS)
    assert log == ["made", "closed"]


def test_a_full_queue_refuses_at_once_and_recovers(renders: RenderThread[Renderer]) -> None:
    finish = occupy(renders)
    waiting = [renders.submit(lambda _: "done") for _ in range(2)]
    with pytest.raises(BusyError, match="2 pictures wait"):
        renders.submit(lambda _: "refused")
    finish()
    assert [job.result(WAIT_SECONDS) for job in waiting] == ["done", "done"]
    assert renders.submit(lambda _: "welcome").result(WAIT_SECONDS) == "welcome"


def test_a_job_given_up_while_it_waited_is_not_run(renders: RenderThread[Renderer]) -> None:
    finish = occupy(renders)
    ran: list[str] = []
    given_up = renders.submit(lambda _: ran.append("given up"))
    assert given_up.cancel()
    kept = renders.submit(lambda _: ran.append("kept"))
    finish()
    kept.result(WAIT_SECONDS)
    assert ran == ["kept"]


def test_a_machine_without_opengl_gives_each_job_the_error_and_tries_again(log: list[str]) -> None:
    drivers = [False, True]

    def make() -> Renderer:
        if not drivers.pop(0):
            raise ResourceError("no EGL here; apt-get install libegl1")
        return Renderer(log)

    renders = RenderThread(make, queue_length=2)
    renders.start()
    try:
        with pytest.raises(ResourceError, match="libegl1"):
            renders.submit(lambda _: 1).result(WAIT_SECONDS)
        assert renders.submit(lambda _: 2).result(WAIT_SECONDS) == 2
    finally:
        renders.close(WAIT_SECONDS)


def test_after_an_unexpected_error_the_next_job_gets_a_fresh_renderer(
    renders: RenderThread[Renderer], log: list[str]
) -> None:
    def crash(_: Renderer) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        renders.submit(crash).result(WAIT_SECONDS)
    assert renders.submit(lambda _: "fine").result(WAIT_SECONDS) == "fine"
    assert log == ["made", "closed", "made"]


def test_an_expected_error_keeps_the_renderer(
    renders: RenderThread[Renderer], log: list[str]
) -> None:
    def refuse(_: Renderer) -> None:
        raise ResourceError("too much")

    with pytest.raises(ResourceError):
        renders.submit(refuse).result(WAIT_SECONDS)
    assert renders.submit(lambda _: "fine").result(WAIT_SECONDS) == "fine"
    assert log == ["made"]


def test_closing_fails_what_waits_and_ends_what_runs(renders: RenderThread[Renderer]) -> None:
    finish = occupy(renders)
    waiting: Future[None] = renders.submit(lambda _: None)
    closing = threading.Thread(target=renders.close, args=(WAIT_SECONDS,))
    closing.start()
    with pytest.raises(BusyError, match="shutting down"):
        waiting.result(WAIT_SECONDS)
    with pytest.raises(BusyError, match="shutting down"):
        renders.submit(lambda _: None)
    finish()
    closing.join(WAIT_SECONDS)
    assert not closing.is_alive()
