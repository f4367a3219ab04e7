"""What a failure of obstore means to someone who reads a source, and what to do about it.

obstore has few classes of errors: what tells them apart is in the text, in which its Rust objects
are printed.
"""

from __future__ import annotations

import os
import re
from http import HTTPStatus

from obstore.exceptions import NotSupportedError

from octobrick.codec.errors import OctobrickError
from octobrick.store.errors import (
    SourceUnreachableError,
    TruncatedSourceError,
    UnsupportedSourceError,
)
from octobrick.store.sources.head import printable
from octobrick.store.sources.location import Url

# Before the objects comes what the server says, which may be anything.
_OBJECTS = "Debug source:"
_STATUS = re.compile(r"inner: Status \{\s*status: (\d{3})\b")
_RETRIES = re.compile(r"\bretries: (\d+)")
_ELAPSED = re.compile(r"\belapsed: ([\d.]+[a-zµ]+)")
_RANGE = re.compile(r"Requested \d+\.\.\d+, got \d+\.\.\d+|Wanted range [^\n]* bytes long")
# Of the system and of TLS; the innermost comes last.
_REASON = re.compile(r'\b(?:message|error): "((?:[^"\\]|\\.)*)"')
_ADDRESS = re.compile(r"\w+://\S+")


def is_broken_off(error: Exception) -> bool:
    """Whether an answer began and did not end; obstore asks again only for those not begun."""
    text = str(error)
    return "HttpError {" in text and "RetryError" not in text


def explained(
    error: Exception, url: Url, key: str, *, knows_ranges: bool = False
) -> OctobrickError:
    """Our error for one of obstore's.

    Args:
        error: what obstore raised.
        url: of the source.
        key: of the object, below the address.
        knows_ranges: whether the server has sent parts of files before.
    """
    if isinstance(error, OctobrickError):
        return error
    text = str(error)
    text = text[max(0, text.find(_OBJECTS)) :] if _STATUS.search(text) else text
    where = f"{url}: {printable(key) or 'it'} cannot be read"
    facts = {"path": str(url), "key": printable(key)}
    if isinstance(error, NotSupportedError) and knows_ranges:
        return SourceUnreachableError(
            f"{where}: the server sends something else than the part that was asked for, as a "
            "page for a login is; look at the address with a browser",
            **facts,
        )
    if isinstance(error, NotSupportedError):
        return UnsupportedSourceError(
            f"{where} in part: the server sends whole files only (no HTTP Range), and sharded "
            "arrays are read in parts; use a server that knows Range, such as nginx or an object "
            "store, or copy the folder here",
            **facts,
        )
    if "MissingContentLength" in text:
        return UnsupportedSourceError(
            f"{where}: the server does not say how long its answers are (no Content-Length); use "
            "another server, or copy the folder here",
            **facts,
        )
    status = int(found[1]) if (found := _STATUS.search(text)) else None
    part = _RANGE.search(text)
    if part or status == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
        detail = part[0].lower() if part else "it ends before the bytes that were asked for (416)"
        return TruncatedSourceError(f"{where}: {detail}; copy or export the data again", **facts)
    reason, advice = _meaning(text, status, url)
    return SourceUnreachableError(
        f"{where}: {reason}{_effort(text)}; {advice}", **facts, status=status
    )


def _meaning(text: str, status: int | None, url: Url) -> tuple[str, str]:
    """Why the server does not give the object, and what to do."""
    later = "run the same again when the server is well"
    match status:
        case None:
            pass
        case 401 | 403:
            return f"the server refuses it ({_phrase(status)})", _credentials_advice(url)
        case 404:
            return f"it is not there ({_phrase(status)})", "check the address"
        case _ if status >= 500 or status in (408, 429):
            return f"the server answers {_phrase(status)}", later
        case _ if url.scheme == "s3" and 300 <= status < 400:
            return f"the bucket is in another region ({_phrase(status)})", "set AWS_REGION to it"
        case _:
            return f"the server answers {_phrase(status)}", "check the address"
    if "kind: Redirect" in text:
        return "the server sends it round in circles", "check the address"
    if "redirect without LOCATION" in text.replace("\n", " "):
        return "the bucket is in another region", "set AWS_REGION to it"
    if "kind: Timeout" in text or "TimedOut" in text:
        return "the server does not answer in time", later
    if "kind: Connect" in text:
        reason = _connection_reason(text)
        return f"no connection to {url.host} ({reason})", f"check the address, or {later}"
    if is_broken_off(Exception(text)):
        return "the answer breaks off before its end", later
    first = printable(_ADDRESS.sub("the server", text.partition("\n")[0]))
    return first, "check the address and the server"


def _connection_reason(text: str) -> str:
    """What the system says, or the names of what went wrong in TLS."""
    if reasons := _REASON.findall(text):
        return printable(reasons[-1])
    names = re.findall(r"[A-Za-z]\w+", text.rpartition("error: ")[2])
    return printable(f"TLS: {' '.join(names)}")


def _credentials_advice(url: Url) -> str:
    if url.scheme != "s3":
        return "it may be for others, or have another address"
    if os.environ.get("AWS_ACCESS_KEY_ID"):
        return (
            "check that these credentials may read it (where they may not list the bucket, what "
            "is not there is refused, too)"
        )
    profile = (
        "profiles are not read: use `aws configure export-credentials --format env`"
        if os.environ.get("AWS_PROFILE")
        else "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY if it is not public"
    )
    return f"it was asked without credentials: {profile}, or check the address"


def _effort(text: str) -> str:
    """How hard it was tried, where it was tried more than once."""
    retries, elapsed = _RETRIES.search(text), _ELAPSED.search(text)
    if retries is None or retries[1] == "0":
        return ""
    seconds = f" in {elapsed[1]}" if elapsed else ""
    return f", {int(retries[1]) + 1} times{seconds}"


def _phrase(status: int) -> str:
    try:
        return f"{status} {HTTPStatus(status).phrase}"
    except ValueError:
        return str(status)
