"""What the service says of volumes: response models, and how a volume becomes one."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from octobrick.store import Level, Volume
from octobrick.store.brick_codec import BrickCodec, codec_text

Zyx = tuple[int, int, int]
Xyz = tuple[float, float, float]
Number = int | float

_EXAMPLE_REVISION = "0f3c1a9be2d84f6c9f27a1b0c5d6e7f8"
_EXAMPLE_SUMMARY: dict[str, Any] = {
    "id": "head",
    "available": True,
    "revision": _EXAMPLE_REVISION,
    "dtype": "int16",
    "shape_zyx": [108, 256, 256],
    "levels": 4,
}


class VolumeSummary(BaseModel):
    """One volume in the list; of one that cannot be opened, the kind of the error."""

    id: str
    available: bool
    revision: str | None = None
    dtype: str | None = None
    shape_zyx: Zyx | None = None
    levels: int | None = None
    error_kind: str | None = None

    @classmethod
    def of(cls, volume_id: str, volume: Volume) -> VolumeSummary:
        """The summary of a volume that is open."""
        return cls(
            id=volume_id,
            available=True,
            revision=volume.revision,
            dtype=str(volume.dtype),
            shape_zyx=volume.levels[0].shape_zyx,
            levels=len(volume.levels),
        )


class VolumeList(BaseModel):
    """All volumes of the server, by id."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "volumes": [
                        _EXAMPLE_SUMMARY,
                        {"id": "torn", "available": False, "error_kind": "corrupt-volume"},
                    ]
                }
            ]
        }
    )

    volumes: list[VolumeSummary]


class LevelDetail(BaseModel):
    """One resolution of a volume."""

    index: int
    shape_zyx: Zyx
    grid_zyx: Zyx = Field(description="Bricks along each axis.")
    spacing_xyz: Xyz
    origin_xyz: Xyz = Field(description="World position of the centre of voxel (0, 0, 0).")
    codec: str = Field(description="What a brick is once its zstd layer is off.")
    nbytes: int = Field(description="Size of the voxels, uncompressed.")
    stored_nbytes: int = Field(description="Size on disk.")
    max_error: float = Field(description="Largest |decoded - original| of the level.")
    psnr_db: float | None = Field(description="Null where nothing was lost.")

    @classmethod
    def of(cls, level: Level, codec: BrickCodec) -> LevelDetail:
        """What a level says of itself."""
        return cls(
            index=level.index,
            shape_zyx=level.shape_zyx,
            grid_zyx=level.grid_zyx,
            spacing_xyz=level.spacing_xyz,
            origin_xyz=level.origin_xyz,
            codec=codec_text(codec),
            nbytes=level.nbytes,
            stored_nbytes=level.stored_nbytes,
            max_error=level.max_error,
            psnr_db=level.psnr_db,
        )


class VolumeDetail(BaseModel):
    """Everything that a client needs to ask for bricks and to place them."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "id": "head",
                    "revision": _EXAMPLE_REVISION,
                    "dtype": "int16",
                    "codec": "s3dc; block=8,8,8; bits=4",
                    "brick_shape_zyx": [64, 64, 64],
                    "timesteps": 1,
                    "channels": 1,
                    "unit": "millimeter",
                    "value_range": [-1024, 3071],
                    "window": [-1020, 1480],
                    "fill_value": 0,
                    "levels": [
                        {
                            "index": 0,
                            "shape_zyx": [108, 256, 256],
                            "grid_zyx": [2, 4, 4],
                            "spacing_xyz": [0.957, 0.957, 1.5],
                            "origin_xyz": [0.0, 0.0, 0.0],
                            "codec": "s3dc; block=8,8,8; bits=4",
                            "nbytes": 14155776,
                            "stored_nbytes": 3018402,
                            "max_error": 117.0,
                            "psnr_db": 47.2,
                        }
                    ],
                    "bricks": f"/v1/volumes/head/{_EXAMPLE_REVISION}"
                    "/bricks/{level}/{t}/{c}/{z}/{y}/{x}",
                    "render": "/v1/volumes/head/render",
                }
            ]
        }
    )

    id: str
    revision: str = Field(description="Names the content; changes when the volume is replaced.")
    dtype: str
    codec: str = Field(description="What a brick of level 0 is once its zstd layer is off.")
    brick_shape_zyx: Zyx
    timesteps: int
    channels: int
    unit: str | None
    value_range: tuple[Number, Number] = Field(description="Of the original voxels.")
    window: tuple[Number, Number] = Field(description="Values that are worth showing.")
    fill_value: Number = Field(description="Value of every voxel of an absent brick.")
    levels: list[LevelDetail]
    bricks: str = Field(description="Template of the address of a brick.")
    render: str = Field(description="Address of pictures of the volume.")

    @classmethod
    def of(cls, volume_id: str, volume: Volume) -> VolumeDetail:
        """What a volume that is open says of itself."""
        low, high = volume.value_range
        dark, bright = volume.window
        address = f"/v1/volumes/{volume_id}"
        return cls(
            id=volume_id,
            revision=volume.revision,
            dtype=str(volume.dtype),
            codec=codec_text(volume.codec),
            brick_shape_zyx=volume.brick_shape_zyx,
            timesteps=volume.nt,
            channels=volume.nc,
            unit=volume.unit,
            value_range=(low, high),
            window=(dark, bright),
            fill_value=volume.fill_value,
            levels=[LevelDetail.of(v, volume.level_codec(v.index)) for v in volume.levels],
            bricks=f"{address}/{volume.revision}/bricks/{{level}}/{{t}}/{{c}}/{{z}}/{{y}}/{{x}}",
            render=f"{address}/render",
        )
