"""Request ids, log lines, metrics, probes, and the headers and limits of every answer."""

from __future__ import annotations

import json
import logging
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families
from pydantic import SecretStr

from octobrick.server import Settings, create_app
from octobrick.server.operations.access_log import AccessLog, shown_path
from octobrick.server.operations.log_format import JsonLines, TextLines
from octobrick.server.operations.metrics import BUCKETS_SECONDS, Metrics
from octobrick.server.operations.metrics_folder import MetricsFolder
from octobrick.server.operations.metrics_text import metrics_text
from octobrick.server.operations.request_id import RequestIds, current_request_id
from octobrick.server.operations.route_label import route_label
from octobrick.server.security.signed_paths import signed_prefix

DOCS = Path(__file__).parents[2] / "docs" / "operations.md"
ErrorOf = Callable[[Any], dict[str, Any]]
EVERYWHERE = ("/healthz", "/v1/volumes", "/v1/volumes/tail", "/nowhere", "/docs", "/metrics")


def samples(text: str) -> dict[tuple[str, ...], float]:
    """Each sample of a metrics page by its name and sorted label values."""
    return {
        (sample.name, *(v for _, v in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


# Request ids


@given(sent=st.one_of(st.none(), st.binary(max_size=80)))
def test_an_id_is_the_clients_if_it_is_sane_and_always_fits_a_log(sent: bytes | None) -> None:
    chosen = RequestIds().choose(sent)
    assert re.fullmatch(r"[A-Za-z0-9._-]{1,64}", chosen)
    if sent is not None and re.fullmatch(rb"[A-Za-z0-9._-]{1,64}", sent):
        assert chosen == sent.decode()


def test_every_answer_has_the_id_of_its_request(client: Any) -> None:
    for path in EVERYWHERE:
        reply = client.get(path, headers={"x-request-id": "mine-1"})
        assert reply.headers["x-request-id"] == "mine-1"
    made = {client.get("/healthz", headers={"x-request-id": "a b"}).headers["x-request-id"]
            for _ in range(3)}  # fmt: skip
    assert len(made) == 3


def test_the_log_of_an_error_has_the_id_of_its_request(
    client: Any, caplog: pytest.LogCaptureFixture
) -> None:
    lines: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: lines.append(JsonLines().format(record))  # type: ignore[method-assign]
    logger = logging.getLogger("octobrick")
    logger.addHandler(handler)
    try:
        client.get("/v1/volumes/torn", headers={"x-request-id": "find-me"})
    finally:
        logger.removeHandler(handler)
    errors = [json.loads(line) for line in lines if "corrupt-volume" in line]
    assert errors
    assert {line["request_id"] for line in errors} == {"find-me"}


# Log lines


def test_a_request_is_one_line_of_json_without_query_or_secret(
    client: Any, caplog: pytest.LogCaptureFixture
) -> None:
    prefix = signed_prefix(b"k" * 32, "head", 99)
    secret = prefix.rsplit("/", 1)[1]
    with caplog.at_level(logging.INFO, "octobrick.access"):
        client.get(f"{prefix}/v1/volumes/head?token=hidden")
        client.get(f"/%73igned/99/{secret}/v1/volumes/head")
    assert len(caplog.records) == 2
    for record in caplog.records:
        line = json.loads(JsonLines().format(record))
        assert line["path"] == "/signed/99/.../v1/volumes/head"
        assert (line["status"], line["error_kind"]) == (404, "route-not-found")
        assert line["nbytes"] > 0
        assert line["seconds"] > 0
        assert line["client"]
        for text in (JsonLines().format(record), TextLines().format(record)):
            assert secret not in text
            assert "hidden" not in text
            assert "\n" not in text


@given(raw_path=st.binary(max_size=600))
def test_no_path_breaks_a_log_line(raw_path: bytes) -> None:
    shown = shown_path(raw_path)
    assert shown.isprintable() or shown == ""
    assert len(shown) < 3_000


@pytest.mark.parametrize(
    ("policy", "wanted"),
    [("none", []), ("errors", [False, False, True, True, True]),
     ("routes", [False, True, True, True, True]), ("all", [True] * 5)],
)  # fmt: skip
def test_the_policy_says_which_requests_get_a_line(policy: Any, wanted: list[bool]) -> None:
    log = AccessLog(policy)
    cases = [("bricks", 200, False), ("render", 200, False), ("bricks", 404, False),
             ("bricks", 200, True), ("render", 0, False)]  # fmt: skip
    assert [log.wants(*case) for case in cases] == (wanted or [False] * 5)


def test_a_traceback_is_one_line_of_json() -> None:
    try:
        raise RuntimeError("broken\nlines")
    except RuntimeError as error:
        info = (type(error), error, error.__traceback__)
    record = logging.LogRecord("octobrick", logging.ERROR, "f.py", 1, "no\nway", (), info)
    token = current_request_id.set("abc")
    try:
        text = JsonLines().format(record)
    finally:
        current_request_id.reset(token)
    assert "\n" not in text
    assert json.loads(text)["request_id"] == "abc"
    assert "RuntimeError" in json.loads(text)["traceback"]


# Metrics


@pytest.fixture
def open_metrics(data_dir: Path, make_client: Any) -> Any:
    with make_client(create_app(Settings(data_dir=data_dir, metrics="all"))) as client:
        yield client


def test_requests_bytes_errors_and_stages_are_counted(open_metrics: Any) -> None:
    client = open_metrics
    nbytes = len(client.get("/v1/volumes/head").content)
    client.get("/v1/volumes/tail")
    client.request("BREW", "/v1/volumes/head")
    found = samples(client.get("/metrics").text)
    assert found["octobrick_requests_total", "GET", "volume", "200"] == 1
    assert found["octobrick_requests_total", "GET", "volume", "404"] == 1
    assert found["octobrick_requests_total", "other", "volume", "405"] == 1
    assert found["octobrick_sent_bytes_total", "volume"] > nbytes
    assert found["octobrick_request_seconds_count", "volume"] == 3
    assert found["octobrick_request_seconds_bucket", "+Inf", "volume"] == 3
    assert found["octobrick_errors_total", "volume-not-found"] == 1
    assert found[("octobrick_catalog_volumes",)] == 4
    assert found[("process_resident_memory_bytes",)] > 1e6


def test_server_timing_becomes_stages_and_nothing_else_does() -> None:
    metrics = Metrics()
    metrics.count_stages("queue;dur=1.5, render;dur=20, evil;dur=3, encode;dur=x, select")
    found = samples(metrics_text(metrics.counts(), "")[0].decode())
    stages = {key[-1]: n for key, n in found.items() if key[0] == "octobrick_stage_seconds_sum"}
    assert stages == {"queue": 0.0015, "render": 0.02}


@given(st.lists(st.floats(0, 100), max_size=20))
def test_a_histogram_has_each_request_once_in_the_right_buckets(seconds: list[float]) -> None:
    metrics = Metrics()
    for s in seconds:
        metrics.count_request("bricks", "GET", 200, 1, s)
    found = samples(metrics_text(metrics.counts(), "")[0].decode())
    for end in BUCKETS_SECONDS if seconds else ():
        below = sum(s <= end for s in seconds)
        assert found["octobrick_request_seconds_bucket", str(end), "bricks"] == below


def test_a_part_that_cannot_tell_hides_no_other() -> None:
    metrics = Metrics()
    metrics.wire("bad", lambda: {"x": 1 / 0})
    metrics.wire("good", lambda: {"crashes_total": 2, "queued": 3})
    text = metrics_text(metrics.counts(), "")[0].decode()
    assert "# TYPE octobrick_good_crashes_total counter" in text
    assert samples(text)[("octobrick_good_crashes_total",)] == 2
    assert samples(text)[("octobrick_good_queued",)] == 3


def test_processes_add_up_and_the_dead_keep_what_they_counted(tmp_path: Path) -> None:
    def counted(requests: int) -> Metrics:
        metrics = Metrics()
        metrics.wire("good", lambda: {"queued": 1})
        for _ in range(requests):
            metrics.count_request("bricks", "GET", 200, 10, 0.001)
        return metrics

    folder = MetricsFolder(tmp_path)
    folder.write(counted(5).counts())
    (own,) = tmp_path.iterdir()
    own.rename(tmp_path / "1.json")  # as if another process had left it
    total = samples(metrics_text(folder.with_others(counted(2).counts()), "")[0].decode())
    assert total["octobrick_requests_total", "GET", "bricks", "200"] == 7
    assert total["octobrick_request_seconds_count", "bricks"] == 7
    assert total[("octobrick_good_queued",)] == 2
    folder.retire(1)
    folder.retire(12345)
    (tmp_path / "2.json").write_text("{")  # damaged: not counted, no error
    total = samples(metrics_text(folder.with_others(counted(2).counts()), "")[0].decode())
    assert total["octobrick_requests_total", "GET", "bricks", "200"] == 7
    assert total[("octobrick_good_queued",)] == 1


def test_labels_are_few_whatever_is_asked() -> None:
    paths = {
        "/v1/volumes/a/b/bricks/0/0/0/0/0/0": "bricks",
        "/v1/volumes/a/b/gradients/0/0/0/0/0/0": "gradients",
        "/v1/volumes/a/b/tables/range/0/0/0": "tables",
        "/v1/volumes/a/bricks": "batch",
        "/v1/volumes/a/select": "select",
        "/v1/volumes/a/render": "render",
        "/v1/volumes/a": "volume",
        "/v1/volumes": "volumes",
        "/zarr/a/zarr.json": "zarr",
        "/precomputed/a/info": "precomputed",
        "/zarr2/a/.zgroup": "zarr",
        "/x": "none",
        "": "none",
    }
    assert {path: route_label(path) for path in paths} == paths


def test_every_metric_is_documented_and_no_other(open_metrics: Any) -> None:
    open_metrics.get("/v1/volumes/tail")
    text = open_metrics.get("/metrics").text
    served = set(re.findall(r"^# TYPE (\w+) ", text, re.MULTILINE))
    documented = set(
        re.findall(r"^\| `(\w+)` \| (?:counter|gauge|histogram)", DOCS.read_text(), re.M)
    )
    assert documented == served


def test_metrics_are_for_whom_the_settings_say(
    data_dir: Path, make_client: Any, error_of: ErrorOf
) -> None:
    token = {"authorization": "Bearer scrape"}
    wrong = {"authorization": "Bearer other"}
    forwarded = {"x-forwarded-for": "192.0.2.1"}
    cases: list[tuple[dict[str, Any], dict[str, str], int]] = [
        ({}, {}, 200),
        ({}, forwarded, 403),
        ({"metrics": "off"}, {}, 404),
        ({"metrics": "off", "metrics_token": SecretStr("scrape")}, {}, 401),
        ({"metrics": "off", "metrics_token": SecretStr("scrape")}, token, 200),
        ({"metrics": "all", "metrics_token": SecretStr("scrape")}, wrong, 401),
        ({"metrics_token": SecretStr("scrape")}, token | forwarded, 200),
    ]
    for given_settings, headers, status in cases:
        with make_client(create_app(Settings(data_dir=data_dir, **given_settings))) as client:
            reply = client.get("/metrics", headers=headers)
            assert reply.status_code == status, (given_settings, headers)
            if status != 200:
                error_of(reply)


# Probes


def test_ready_means_that_volumes_can_be_listed_and_nobody_said_stop(
    client: Any, error_of: ErrorOf, data_dir: Path
) -> None:
    assert client.get("/readyz").json() == {"status": "ready"}
    shutil.rmtree(data_dir)
    reply = client.get("/readyz")
    assert reply.status_code == 503
    assert reply.headers["retry-after"]
    assert error_of(reply)["facts"] == {"reasons": ["volumes-not-listed"]}
    data_dir.mkdir()
    assert client.get("/readyz").status_code == 200
    client.app.state.services.draining = True
    assert error_of(client.get("/readyz"))["facts"] == {"reasons": ["stopping"]}
    assert client.get("/healthz").status_code == 200


def test_a_warm_start_opens_what_can_be_opened(data_dir: Path, make_client: Any) -> None:
    with make_client(create_app(Settings(data_dir=data_dir))) as client:
        services = client.app.state.services
        services._warm_start.wait()
        assert services.catalog.stats() == {"volumes": 4, "open_volumes": 2}


# Headers and limits


def test_every_answer_has_the_headers_that_keep_browsers_careful(client: Any) -> None:
    for path in EVERYWHERE:
        headers = client.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
        assert headers["referrer-policy"] == "no-referrer"
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert headers.get_list("content-security-policy")[1:] == []
        assert "default-src 'none'" in headers["content-security-policy"]
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "server" not in headers


def test_where_other_origins_may_read_they_may_embed(data_dir: Path, make_client: Any) -> None:
    settings = Settings(data_dir=data_dir, cors_origins=("https://example.org",))
    with make_client(create_app(settings)) as client:
        headers = client.get("/healthz").headers
        assert headers["cross-origin-resource-policy"] == "cross-origin"


@pytest.mark.parametrize("where", ["/healthz?{}", "/v1/volumes/{}"])
def test_a_long_address_is_414(client: Any, error_of: ErrorOf, where: str) -> None:
    reply = client.get(where.format("a" * 9_000))
    assert reply.status_code == 414
    assert error_of(reply)["facts"]["limit_name"] == "max_target_nbytes"


def test_many_headers_are_431(client: Any, error_of: ErrorOf) -> None:
    reply = client.get("/healthz", headers={f"x-{i}": "a" for i in range(120)})
    assert reply.status_code == 431
    assert error_of(reply)["facts"]["limit"] == 100


def test_answers_to_head_say_their_error_kind(client: Any) -> None:
    reply = client.request("HEAD", "/v1/volumes/head/0a/bricks/0/0/0/0/0/0")
    assert reply.headers["x-octobrick-error"] == "revision-gone"
