"""When a camera's picture is no longer trusted (``[watch]`` in ``edge.toml``)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from slipstream.config import Settings

Seconds = Annotated[float, Field(gt=0, le=60, allow_inf_nan=False)]
Share = Annotated[float, Field(gt=0, lt=1)]


class WatchSettings(Settings):
    """How long a fault must last to count, and how far a camera may drift."""

    sample_s: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.2, description="Pictures so far apart are looked at."
    )
    frozen_after_s: Seconds = Field(
        default=5.0, description="A road on which nothing changes, not even noise, for so long."
    )
    exposure_after_s: Seconds = Field(
        default=1.0, description="Black, white or without any detail for so long."
    )
    moved_after_s: Seconds = Field(
        default=5.0, description="Away from the calibrated view for so long; gusts are shorter."
    )
    moved_share: Annotated[float, Field(gt=0, le=0.05)] = Field(
        default=0.003,
        description="How far the view may shift, as a share of the picture's width.",
    )
    stale_after_s: Seconds = Field(default=3.0, description="No new picture for so long.")
    clock_step_s: Seconds = Field(
        default=0.5, description="A step of the wall clock against the monotonic one."
    )
    max_repeated_share: Share = Field(
        default=0.25,
        description="Share of the picture that may be flat or streaky, as lost parts are; raise it "
        "for a camera with large grey privacy masks.",
    )
    clear_after_s: Seconds = Field(
        default=2.0, description="A fault ends when nothing was seen of it for so long."
    )
