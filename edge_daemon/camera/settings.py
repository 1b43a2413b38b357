"""The content of a ``camera.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from slipstream.config import Settings
from slipstream.messages import Identifier

Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
Pair = tuple[Coordinate, Coordinate]


class CalibrationPoint(Settings):
    """A point known both in the picture and on the road."""

    image: Pair = Field(description="(u, v) in px, origin at the top left.")
    road: Pair = Field(description="(x, y) in m, y to the left of x as on a map.")


class ImageSize(Settings):
    """Size of the picture that the calibration was made on, px."""

    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]


class SegmentSettings(Settings):
    """The part of a road segment that the camera watches."""

    id: Identifier
    polygon: Annotated[tuple[Pair, ...], Field(min_length=3, description="m on the road plane.")]
    direction: Pair = Field(description="Direction of travel on the road plane.")
    lanes: Annotated[int, Field(ge=1)] = 1
    lane_width_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = 3.5


class CameraSettings(Settings):
    """A calibrated camera and what it watches."""

    schema_version: Literal[1] = Field(alias="schema")
    name: str
    reference: Path | None = Field(
        default=None,
        description="The picture that the calibration was made on, relative to the file.",
    )
    image: ImageSize
    points: Annotated[tuple[CalibrationPoint, ...], Field(min_length=4)]
    segments: Annotated[tuple[SegmentSettings, ...], Field(min_length=1)]
