"""Addresses that try to reach a file, spelled in every way; each over a real socket, as bytes."""

from __future__ import annotations

from typing import Any

import pytest

UP = {
    "plain": "..",
    "encoded": "%2e%2e",
    "half encoded": ".%2e",
    "upper case": "%2E%2E",
    "double": "%252e%252e",
    "overlong two bytes": "%c0%ae%c0%ae",
    "overlong three bytes": "%e0%80%ae%e0%80%ae",
    "full width": "%ef%bc%8e%ef%bc%8e",
    "utf-16": "%u002e%u002e",
    "path parameter": "..;",
    "path parameter encoded": "..%3b",
    "NUL": "..%00",
    "blank": "..%20",
    "tab": "..%09",
    "line feed": "..%0a",
    "four dots": "....",
}
SLASH = {
    "plain": "/",
    "double": "//",
    "encoded": "%2f",
    "twice encoded": "%252f",
    "overlong": "%c0%af",
    "backslash": "\\",
    "backslash encoded": "%5c",
    "division slash": "%e2%88%95",
}
PLACES = ["/v1/volumes/{}", "/v1/volumes/head/{}", "/{}", "/docs/{}", "/zarr/{}", "/precomputed/{}"]
PLACES += ["/v1/volumes/{}/render", "/v1/volumes/head/{}/bricks/0/0/0/0/0/0"]


@pytest.mark.parametrize("up", UP)
@pytest.mark.parametrize("slash", SLASH)
def test_no_spelling_of_a_way_up_leads_out(target: Any, up: str, slash: str) -> None:
    for place in PLACES:
        for goal in ("secret", "secret.zarr", "secret.zarr/zarr.json", "etc/passwd"):
            way = SLASH[slash].join((UP[up], UP[up], *goal.split("/")))
            reply = target.ask("GET", place.format(way))
            target.assert_refused(reply)
            assert target.secret_revision.encode() not in reply.body


@pytest.mark.parametrize(
    "name",
    [
        *("secret", "head.zarr", "./head", "head/", "head/.", "HEAD", "head%20", "%20head"),
        *("head%00", "head%00.zarr", "/etc/passwd", "C:%5csecret", "file:///etc/passwd", "~", "*"),
        *("%ff%fe", "%80", "%", "%zz", "$%7bhome%7d", "CON", "-", "h%C3%A9ad", "h" * 5000),
        *("{volume_id}", "head%0d%0aX-Evil:%201", "head%0aX", "0" * 200),
    ],
)
def test_a_name_is_looked_up_and_never_a_path(target: Any, name: str) -> None:
    reply = target.ask("GET", f"/v1/volumes/{name}/attributes-of-no-kind")
    target.assert_refused(reply)
    assert not any(field.lower() == "x-evil" for field, _ in reply.headers)
    target.assert_unharmed()


@pytest.mark.parametrize("length", [9_000, 70_000])
def test_an_endless_address_is_refused(target: Any, length: int) -> None:
    for line in (f"/{'a' * length}", f"/v1/volumes?{'a=b&' * (length // 4)}"):
        answer = target.raw(f"GET {line} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode())
        assert not answer or answer.split()[1] in (b"200", b"400", b"404", b"413", b"414", b"431")
    target.assert_unharmed()


def test_numbers_of_any_length_are_no_index(target: Any) -> None:
    place = f"/v1/volumes/head/{target.revision}/bricks"
    for index in ("9" * 9, "9" * 10, "9" * 4_000, "-1", "1e3", "0x1", "1__0", "1.5", "nan", "%00"):
        target.assert_refused(target.ask("GET", f"{place}/0/0/0/0/0/{index}"))
    target.assert_unharmed()
