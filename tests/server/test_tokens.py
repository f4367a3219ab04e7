"""The tokens file: what it may say, and how a change of it reaches a running server."""

from __future__ import annotations

import json
import logging
import stat
from datetime import UTC, datetime
from pathlib import Path

import pytest

from octobrick.codec.errors import InvalidInputError, OctobrickError, ResourceError
from octobrick.server.security.tokens import find_token, new_secret, parse_tokens, token_entry
from octobrick.server.security.watched_file import WatchedFile

GOOD = {"name": "ann", "sha256": "0" * 64, "volumes": ["head*"]}


def test_a_new_token_is_found_by_its_secret_and_only_the_hash_is_kept() -> None:
    secret = new_secret()
    text = json.dumps([token_entry("ann", secret, ("head*", "tail"), None)])
    assert secret not in text
    tokens = parse_tokens(text)
    found = find_token(tokens, secret.encode())
    assert found is tokens[0]
    assert [found.allows(i) for i in ("head", "head-2", "tail", "tail-2", "ahead")] == [
        *(True, True, True, False, False)
    ]
    for other in ("", secret[:-1], secret + "x", tokens[0].digest.hex()):
        assert find_token(tokens, other.encode()) is None


def test_expiry_is_kept_with_its_zone() -> None:
    end = datetime(2027, 1, 31, tzinfo=UTC)
    (token,) = parse_tokens(json.dumps([token_entry("ann", "s", ("*",), end)]))
    assert token.expires_unix == end.timestamp()
    assert token.allows_all


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[1]",
        "[" * 100_000,
        json.dumps([{**GOOD, "name": "signed"}]),
        json.dumps([{**GOOD, "name": "a b"}]),
        json.dumps([{**GOOD, "sha256": "secret"}]),
        json.dumps([{**GOOD, "volumes": []}]),
        json.dumps([{**GOOD, "volumes": "head"}]),
        json.dumps([{**GOOD, "volumes": ["a/b"]}]),
        json.dumps([{**GOOD, "expires": "2027-01-31T00:00:00"}]),  # of which zone?
        json.dumps([{**GOOD, "expires": 5}]),
        json.dumps([{**GOOD, "token": "a secret by mistake"}]),
        json.dumps([GOOD, GOOD]),
    ],
)
def test_an_unsound_file_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match="tokens file"):
        parse_tokens(text)


def test_a_change_counts_and_a_broken_file_leaves_the_old_one(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    now = [0.0]
    path = tmp_path / "numbers"
    path.write_text("1")

    def parse(text: str) -> int:
        if not text.isdigit():
            raise InvalidInputError("no number")
        return int(text)

    file = WatchedFile(path, parse, stat.S_IWOTH, lambda: now[0])
    path.write_text("22")
    assert file.value() == 1, "within a second it is not looked at"
    now[0] = 1.0
    assert file.value() == 22
    path.write_text("broken")
    now[0] = 2.0
    with caplog.at_level(logging.ERROR):
        assert file.value() == 22
    assert "the version before stays in use: no number" in caplog.text
    path.unlink()
    now[0] = 3.0
    assert file.value() == 22
    path.write_text("333")
    now[0] = 4.0
    assert file.value() == 333


@pytest.mark.parametrize("content", [b"\xff\xfe", b"x" * (1 << 21)])
def test_what_is_no_text_of_sensible_length_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(InvalidInputError, match="file"):
        WatchedFile(path, str, 0)


def test_a_file_that_others_may_change_or_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with pytest.raises(ResourceError, match="No such file"):
        WatchedFile(path, str, 0)
    path.write_text("x")
    path.chmod(0o646)
    with pytest.raises(OctobrickError, match=f"chmod 0644 {path}"):
        WatchedFile(path, str, stat.S_IWOTH)
