"""Liveness."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict

router = APIRouter(tags=["operations"])


class Health(BaseModel):
    """The server answers."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"status": "ok"}]})

    status: str


@router.get("/healthz", summary="Liveness")
async def healthz() -> Health:
    """200 as long as the process answers requests; says nothing of any volume."""
    return Health(status="ok")
