"""The server's settings, from arguments or from ``OCTOBRICK_…`` environment variables."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Everything that an operator can set; checked once, then fixed.

    docs/settings.md lists every field; a test compares the two.
    """

    model_config = SettingsConfigDict(env_prefix="OCTOBRICK_", frozen=True, extra="forbid")

    # What is served, and where

    data_dir: Path = Field(description="Folder whose `*.zarr` volumes are served.")
    host: str = Field(default="127.0.0.1", description="Address to listen on.")
    port: int = Field(
        default=8000, ge=0, le=65_535, description="TCP port to listen on; 0 takes a free one."
    )

    # Processes

    shutdown_seconds: int = Field(
        default=10, ge=0, description="How long a stopping server waits for requests under way."
    )

    # Who may ask

    cors_origins: tuple[str, ...] = Field(
        default=(),
        description="Web origins whose pages may read answers, as a JSON list; `*` for all.",
    )

    # Requests

    max_body_nbytes: int = Field(default=65_536, ge=0, description="Longest request body accepted.")

    # Bricks

    read_threads: int = Field(
        default=4, ge=1, le=64, description="Threads that read bricks from disk."
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
        default="info",
        description="Least severe message that is logged; `debug` adds an access log.",
    )
