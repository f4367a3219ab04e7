"""The server's settings, from arguments or from ``OCTOBRICK_…`` environment variables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, SecretStr, StringConstraints, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

VolumeName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$")]


class Settings(BaseSettings):
    """Everything that an operator can set; checked once, then fixed.

    docs/settings.md lists every field; a test compares the two.
    """

    model_config = SettingsConfigDict(env_prefix="OCTOBRICK_", frozen=True, extra="forbid")

    # What is served, and where

    data_dir: Path | None = Field(
        default=None, description="Folder whose `*.zarr` volumes are served."
    )
    volumes: dict[VolumeName, Path] = Field(
        default={},
        description="Volumes that lie elsewhere, as a JSON object of ids and paths. One of these "
        "two is required.",
    )
    host: str = Field(default="127.0.0.1", description="Address to listen on.")
    port: int = Field(
        default=8000, ge=0, le=65_535, description="TCP port to listen on; 0 takes a free one."
    )

    # Processes

    workers: int = Field(
        default=1, ge=1, le=256, description="Server processes that share the socket."
    )
    warm_start: bool = Field(
        default=True,
        description="Open volumes and read their tables in the background once started.",
    )
    drain_seconds: float = Field(
        default=0.0,
        ge=0,
        description="How long a stopping server, no longer ready, still takes new connections.",
    )
    shutdown_seconds: int = Field(
        default=10, ge=0, description="How long a stopping server waits for requests under way."
    )

    # Who may ask

    cors_origins: tuple[str, ...] = Field(
        default=(),
        description="Web origins whose pages may read answers, as a JSON list; `*` for all.",
    )
    tokens_file: Path | None = Field(
        default=None,
        description="JSON file of tokens, of which every request then needs one (security.md).",
    )
    signing_key_file: Path | None = Field(
        default=None,
        description="File of the keys of signed addresses, one a line, the first one signs.",
    )
    signing_key: SecretStr | None = Field(
        default=None, description="The key of signed addresses itself, instead of a file."
    )
    trusted_proxies: tuple[str, ...] = Field(
        default=(),
        description="Addresses or networks whose `X-Forwarded-For` and `-Proto` are believed.",
    )
    metrics: Literal["loopback", "all", "off"] = Field(
        default="loopback",
        description="Who may read `/metrics` without `metrics_token`; `loopback` is this machine.",
    )
    metrics_token: SecretStr | None = Field(
        default=None, description="Token that lets anybody read `/metrics`."
    )

    # Requests

    max_body_nbytes: int = Field(
        default=262_144, ge=0, description="Longest request body accepted."
    )
    max_target_nbytes: int = Field(
        default=8_192, ge=256, description="Longest path and query accepted."
    )
    max_header_nbytes: int = Field(
        default=32_768, ge=1_024, description="Most bytes of a request before its body."
    )
    max_header_count: int = Field(default=100, ge=8, description="Most headers of a request.")
    max_connections: int = Field(
        default=2_048, ge=1, description="Connections of a process; more are answered 503."
    )
    receive_seconds: int = Field(
        default=30, ge=1, description="Longest time that sending a whole request may take."
    )
    stall_seconds: int = Field(
        default=120,
        ge=1,
        description="A client that takes nothing of its answer for so long is cut off.",
    )
    keep_alive_seconds: int = Field(
        default=75, ge=1, description="How long an idle connection stays open."
    )

    # Bricks

    read_threads: int = Field(
        default=4, ge=1, le=64, description="Threads that read bricks from disk."
    )
    max_batch_bricks: int = Field(
        default=4_096, ge=1, le=65_536, description="Most bricks in one answer."
    )
    max_selected_bricks: int = Field(
        default=16_384,
        ge=1,
        le=1_048_576,
        description="Most bricks that a selection lists; those that come last are left out.",
    )
    table_cache_nbytes: int = Field(
        default=67_108_864,
        ge=0,
        description="Memory for tables of ranges and errors, compressed (64 MiB).",
    )
    decoded_cache_nbytes: int = Field(
        default=268_435_456,
        ge=0,
        description="Memory for bricks without zstd, for clients that take none; 0 keeps none.",
    )
    chunk_cache_nbytes: int = Field(
        default=268_435_456,
        ge=0,
        description="Memory for chunks made for readers of other formats (256 MiB); 0 keeps none.",
    )

    # Pictures

    max_image_side: int = Field(
        default=4_096, ge=1, description="Longest side of a rendered picture, in pixels."
    )
    max_image_pixels: int = Field(
        default=4_194_304, ge=1, description="Most pixels of a rendered picture (2048 x 2048)."
    )
    render_workers: int = Field(
        default=1,
        ge=0,
        le=64,
        description="Processes that render, for each server process; 0 renders nothing.",
    )
    render_memory_budget_nbytes: int = Field(
        default=536_870_912,
        ge=1,
        description="Memory that each renderer may use for bricks (512 MiB).",
    )
    render_memory_limit_nbytes: int = Field(
        default=0,
        ge=0,
        description="Resident memory at which a render process is replaced; 0 sets no limit.",
    )
    render_queue_length: int = Field(
        default=32, ge=1, description="Pictures that may wait for a worker; more are answered 503."
    )
    render_queue_per_client: int = Field(
        default=8, ge=1, description="Pictures of one client that may wait; more are answered 503."
    )
    render_timeout_seconds: float = Field(
        default=60.0, gt=0, description="Longest time a picture may take, waiting included."
    )

    # Logs and measurements

    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info", description="Least severe message that is logged."
    )
    log_format: Literal["text", "json"] = Field(
        default="text", description="Lines for people, or one JSON object a line."
    )
    access_log: Literal["none", "errors", "routes", "all"] = Field(
        default="routes",
        description="Requests that get a line; `routes` leaves out good bricks and probes.",
    )

    @model_validator(mode="after")
    def _require_volumes(self) -> Self:
        if self.data_dir is None and not self.volumes:
            raise ValueError("name a folder of volumes (data_dir), or list some (volumes)")
        return self
