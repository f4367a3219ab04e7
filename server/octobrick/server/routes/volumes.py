"""The list of volumes, and what is known of one."""

from __future__ import annotations

import logging

from fastapi import APIRouter, Response

from octobrick.codec.errors import OctobrickError
from octobrick.server.catalog import unknown_volume
from octobrick.server.errors import InternalError
from octobrick.server.models import VolumeDetail, VolumeList, VolumeSummary
from octobrick.server.routes.shared import VolumeId, documented
from octobrick.server.services import AccessDep, ServicesDep
from octobrick.store.errors import VolumeFormatError

logger = logging.getLogger(__name__)

router = APIRouter(prefix="/v1", tags=["volumes"])

_BROKEN = VolumeFormatError("head.zarr/zarr.json: not JSON; restore the file or ingest again")


@router.get("/volumes", summary="All volumes", response_model_exclude_none=True)
def list_volumes(services: ServicesDep, access: AccessDep, response: Response) -> VolumeList:
    """The volumes that are there now; one that cannot be opened says why by the error's kind.

    On a server with tokens, those that the caller may see.
    """
    response.headers["cache-control"] = "no-cache"
    seen = [i for i in services.catalog.scan() if access is None or access.allows(i)]
    return VolumeList(volumes=[_summary(services, volume_id) for volume_id in seen])


@router.get(
    "/volumes/{volume_id}",
    summary="Metadata of one volume",
    responses=documented(unknown_volume("tail"), _BROKEN),
)
def get_volume(
    services: ServicesDep, access: AccessDep, volume_id: VolumeId, response: Response
) -> VolumeDetail:
    """Shape, levels, codec, ranges and revision of a volume, and where its bricks are."""
    with services.catalog.borrow(volume_id) as lent:
        response.headers["cache-control"] = "no-cache"
        detail = VolumeDetail.of(volume_id, lent.volume)
    if access is not None and access.prefix:  # who came by a signed address goes on with it
        detail = detail.model_copy(update={"bricks": access.prefix + detail.bricks})
    return detail


def _summary(services: ServicesDep, volume_id: str) -> VolumeSummary:
    try:
        with services.catalog.borrow(volume_id) as lent:
            return VolumeSummary.of(volume_id, lent.volume)
    except OctobrickError as error:
        return VolumeSummary(id=volume_id, available=False, error_kind=error.kind)
    except Exception:  # whatever is wrong with one volume, the others are listed
        logger.exception("volume %s cannot be described", volume_id)
        return VolumeSummary(id=volume_id, available=False, error_kind=InternalError.kind)
