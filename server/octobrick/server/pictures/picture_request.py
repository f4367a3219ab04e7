"""A picture, from a query or from JSON: a view, how it is packed, and what it may take."""

from __future__ import annotations

from typing import ClassVar

from pydantic import BaseModel, Field

from octobrick.codec.errors import InvalidInputError
from octobrick.server.errors import LimitError
from octobrick.server.pictures.render_task import CONTENT_TYPES, Format
from octobrick.server.settings import Settings
from octobrick.server.views.view import View
from octobrick.server.views.view_request import ViewBody, ViewQuery


class _PictureFields(BaseModel):
    """What a picture has besides its view."""

    quality: int | None = Field(
        None, ge=1, le=100, description="Of webp (lossless without) and of jpeg (92 without)."
    )
    progressive: bool = Field(
        False, description="Send a coarse picture first: multipart/x-mixed-replace."
    )
    budget_nbytes: int | None = Field(
        None,
        ge=1,
        description="Bytes that the picture's bricks may take, compressed; where they would take "
        "more, a coarser level is shown.",
    )
    timeout_seconds: float | None = Field(
        None, gt=0, description="How long to wait; the server's own limit without."
    )

    def require_limits(self, settings: Settings) -> None:
        """Refuse budgets beyond those of the settings.

        Raises:
            LimitError: with the name of the limit and both values.
        """
        for name, value, limit_name in (
            ("budget_nbytes", self.budget_nbytes, "render_memory_budget_nbytes"),
            ("timeout_seconds", self.timeout_seconds, "render_timeout_seconds"),
        ):
            limit = getattr(settings, limit_name)
            if value is not None and value > limit:
                raise LimitError(
                    f"{name} is {value}; this server gives a picture at most {limit}",
                    limit_name=limit_name,
                    limit=limit,
                    value=value,
                )


class PictureBody(ViewBody, _PictureFields):
    """A picture, as JSON."""

    format: Format = Field("png", description="Of the picture.")

    def to_view(self) -> View:
        """The view that the fields mean.

        Raises:
            InvalidInputError: fields that do not go together.
        """
        if self.format == "png" and self.quality is not None:
            raise InvalidInputError(
                f"quality: {self.quality} means nothing, since png loses nothing; leave it out, "
                "or choose webp or jpeg",
                field="quality",
            )
        view = super().to_view()
        if self.format == "jpeg" and view.background is None:
            raise InvalidInputError(
                "background: jpeg has no transparency; choose a colour, png or webp",
                field="background",
            )
        return view


class PictureQuery(ViewQuery, _PictureFields):
    """A picture, all in the query of an address."""

    body_type: ClassVar[type[ViewBody]] = PictureBody

    format: Format | None = Field(
        None, description="Of the picture; without, the best of the Accept header, or png."
    )

    def picture(self, accept: str) -> PictureBody:
        """The same picture as JSON has it.

        Args:
            accept: the Accept header, which has a say where the query names no format.

        Raises:
            InvalidInputError: a text that is not what it should be; the field is named.
        """
        body = self.as_body()
        assert isinstance(body, PictureBody)
        if self.format is not None:
            return body
        transparent = self.background == "transparent"
        return body.model_copy(update={"format": accepted_format(accept, transparent)})


def accepted_format(accept: str, transparent: bool) -> Format:
    """The format that an Accept header (RFC 9110, 12.5.1) likes best; png among equals.

    A header that has none of them gets png: a picture is of more use than a refusal. A transparent
    picture is never jpeg.
    """
    weights: dict[str, float] = {}
    for item in accept.lower().split(","):
        kind, *parameters = (part.strip() for part in item.split(";"))
        weights[kind] = _weight(parameters)

    def weight_of(picture: Format) -> float:
        if picture == "jpeg" and transparent:
            return 0.0
        for kind in (CONTENT_TYPES[picture], "image/*", "*/*"):
            if kind in weights:
                return weights[kind]
        return 0.0

    return max(CONTENT_TYPES, key=weight_of)


def _weight(parameters: list[str]) -> float:
    for parameter in parameters:
        name, _, value = parameter.partition("=")
        if name.strip() == "q":
            try:
                return min(max(float(value), 0.0), 1.0)
            except ValueError:
                return 0.0
    return 1.0
