"""Signed prefixes: what was signed is good, and nothing else is."""

from __future__ import annotations

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from octobrick.codec.errors import InvalidInputError
from octobrick.server.security.signed_paths import (
    is_signed,
    parse_keys,
    parse_prefix,
    signed_prefix,
    without_signature,
)

KEY, OTHER = b"k" * 32, b"o" * 32
IDS = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True)
TIMES = st.integers(0, 10**12 - 1)


@given(volume_id=IDS, expires=TIMES)
def test_what_was_signed_is_good_for_its_volume_and_time(volume_id: str, expires: int) -> None:
    text = signed_prefix(KEY, volume_id, expires)
    prefix = parse_prefix(f"{text}/zarr/{volume_id}")
    assert prefix is not None
    assert prefix.expires_unix == expires
    assert prefix.length == len(text)
    assert is_signed(prefix, volume_id, (KEY,))
    assert is_signed(prefix, volume_id, (OTHER, KEY)), "an older key is still good"
    assert not is_signed(prefix, volume_id, (OTHER,))
    assert not is_signed(prefix, volume_id, ())


@given(volume_id=IDS, other=IDS, expires=TIMES)
def test_a_signature_is_not_good_for_another_volume(
    volume_id: str, other: str, expires: int
) -> None:
    assume(volume_id != other)
    prefix = parse_prefix(signed_prefix(KEY, volume_id, expires) + "/")
    assert prefix is not None
    assert not is_signed(prefix, other, (KEY,))


@given(volume_id=IDS, expires=TIMES, at=st.integers(0, 100), to=st.characters(max_codepoint=0x2FF))
def test_any_change_of_a_prefix_is_refused(volume_id: str, expires: int, at: int, to: str) -> None:
    text = signed_prefix(KEY, volume_id, expires)
    at = len("/signed/") + at % (len(text) - len("/signed/"))
    assume(to not in (text[at], "/"))  # a slash behind it ends the prefix, and changes nothing
    for changed in (text[:at] + to + text[at + 1 :], text[:at] + text[at + 1 :], text + to):
        prefix = parse_prefix(f"{changed}/")
        assert prefix is None or not is_signed(prefix, volume_id, (KEY,))


@given(first=IDS, second=IDS)
def test_id_and_expiry_do_not_run_together(first: str, second: str) -> None:
    assume(first != second)
    assert signed_prefix(KEY, first, 1) != signed_prefix(KEY, second, 1)
    assert signed_prefix(KEY, f"2{first}", 1) != signed_prefix(KEY, first, 12)


@pytest.mark.parametrize("text", ["", "\n\n", "short", "k" * 31, "k" * 32 + "\nshort"])
def test_a_key_that_could_be_guessed_is_refused_and_not_shown(text: str) -> None:
    with pytest.raises(InvalidInputError, match="openssl rand") as caught:
        parse_keys(text, "file")
    assert "short" not in str(caught.value)


def test_a_logged_path_has_no_signature() -> None:
    prefix = signed_prefix(KEY, "head", 99)
    secret = prefix.rsplit("/", 1)[1]
    for path in (
        f"{prefix}/v1/volumes/head",
        prefix,
        f"/signed/99/{secret}x",
        f"//signed//{secret}",
    ):
        assert secret not in without_signature(path)
    assert without_signature(f"{prefix}/zarr/head") == "/signed/99/.../zarr/head"
    assert without_signature("/v1/volumes") == "/v1/volumes"
