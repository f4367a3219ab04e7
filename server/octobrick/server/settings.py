"""The server's settings, from arguments or from ``OCTOBRICK_…`` environment variables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, StringConstraints, model_validator
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

    shutdown_seconds: int = Field(
        default=10, ge=0, description="How long a stopping server waits for requests under way."
    )

    # Who may ask

    cors_origins: tuple[str, ...] = Field(
        default=(),
        description="Web origins whose pages may read answers, as a JSON list; `*` for all.",
    )

    # Requests

    max_body_nbytes: int = Field(
        default=262_144, ge=0, description="Longest request body accepted."
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

    # Pictures

    max_image_side: int = Field(
        default=4_096, ge=1, description="Longest side of a rendered picture, in pixels."
    )
    max_image_pixels: int = Field(
        default=4_194_304, ge=1, description="Most pixels of a rendered picture (2048 x 2048)."
    )
    render_memory_budget_nbytes: int = Field(
        default=536_870_912,
        ge=1,
        description="Memory that the renderer may use for bricks (512 MiB).",
    )
    render_queue_length: int = Field(
        default=8,
        ge=1,
        description="Pictures that may wait for the renderer; more are answered 503.",
    )
    render_timeout_seconds: float = Field(
        default=60.0, gt=0, description="Longest time a picture may take, waiting included."
    )

    # Logs and measurements

    log_level: Literal["debug", "info", "warning", "error"] = Field(
        default="info",
        description="Least severe message that is logged; `debug` adds an access log.",
    )

    @model_validator(mode="after")
    def _require_volumes(self) -> Self:
        if self.data_dir is None and not self.volumes:
            raise ValueError("name a folder of volumes (data_dir), or list some (volumes)")
        return self
