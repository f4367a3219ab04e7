"""Zarr arrays and OME-Zarr images on servers: HTTP, HTTPS and S3."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from octobrick.codec.errors import InvalidInputError
from octobrick.store.errors import SourceNotFoundError
from octobrick.store.sources.base import Pick, Source
from octobrick.store.sources.head import missing_package
from octobrick.store.sources.location import Url
from octobrick.store.sources.zarr_source import open_zarr_store

if TYPE_CHECKING:
    from obstore.store import ClientConfig, HTTPStore, RetryConfig, S3Store

# Of one connection, and of the silence between two parts of an answer.
_CONNECT_SECONDS = 10.0
_SILENCE_SECONDS = 30.0
# Of a whole answer, so that even a server that sends a byte now and then is given up.
_ANSWER_SECONDS = 600.0
_BACKOFF_SECONDS = 0.5
_BACKOFF_LIMIT_SECONDS = 10.0
_BACKOFF_BASE = 4  # pauses are drawn from one to so many times the last: twice it on average
# A slip of the pen in an address should be told at once; hours of reading are worth waiting for.
_RETRIES_AT_FIRST = 2
_RETRIES = 12
_RETRIES_LIMIT_SECONDS = 120.0

# Any of these says where credentials come from.
_CREDENTIALS = (
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
)
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")


def open_remote(url: Url, pick: Pick) -> Source:
    """An array or an image on a server; raises what `open_zarr_store` does.

    Raises:
        SourceUnreachableError: the server does not answer, or refuses to.
        ResourceError: the package obstore is missing.
    """
    try:
        import obstore  # noqa: F401  in the extra "remote"
    except ImportError as error:
        raise missing_package("obstore", url, extra="remote") from error
    from octobrick.store.sources.reading import reading
    from octobrick.store.sources.remote_store import RemoteStore

    store = RemoteStore(url, _connect(url, _RETRIES_AT_FIRST))
    try:
        with reading():
            source = open_zarr_store(store, url, pick, remote=store)
    except (SourceNotFoundError, InvalidInputError) as error:
        if store.refusal is not None:
            raise store.refusal from error
        raise
    store.store = _connect(url, _RETRIES)
    return source


def is_anonymous(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether requests to S3 are not signed: where the environment has nothing to sign with."""
    return not any(environment.get(name) for name in _CREDENTIALS)


def _connect(url: Url, retries: int) -> HTTPStore | S3Store:
    from obstore.store import HTTPStore, S3Store

    client: ClientConfig = {
        "allow_http": True,
        "connect_timeout": timedelta(seconds=_CONNECT_SECONDS),
        "read_timeout": timedelta(seconds=_SILENCE_SECONDS),
        "timeout": timedelta(seconds=_ANSWER_SECONDS),
        "user_agent": "octobrick",
    }
    retry: RetryConfig = {
        "max_retries": retries,
        "retry_timeout": timedelta(seconds=_RETRIES_LIMIT_SECONDS),
        "backoff": {
            "init_backoff": timedelta(seconds=_BACKOFF_SECONDS),
            "max_backoff": timedelta(seconds=_BACKOFF_LIMIT_SECONDS),
            "base": _BACKOFF_BASE,
        },
    }
    try:
        if url.scheme != "s3":
            if url.login is not None:
                token = base64.b64encode(":".join(url.login).encode()).decode()
                client["default_headers"] = {"authorization": f"Basic {token}"}
            return HTTPStore(url.address, client_options=client, retry_config=retry)
        # Plain HTTP only where the environment names such an endpoint.
        named = next((os.environ[name] for name in _ENDPOINTS if os.environ.get(name)), "")
        client["allow_http"] = named.lower().startswith("http://")
        unsigned: dict[str, Any] = {"skip_signature": True} if is_anonymous() else {}
        return S3Store(
            url.host, prefix=url.key, client_options=client, retry_config=retry, **unsigned
        )
    except Exception as error:
        text = str(error).partition("\n")[0]
        raise InvalidInputError(
            f"{url}: cannot be connected to: {text}; check the address and the AWS_ variables",
            path=str(url),
        ) from error
