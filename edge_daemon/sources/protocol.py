"""What a source of frames is, its settings and counters."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, Protocol, Self

from pydantic import Field, model_validator

from edge_daemon.frame import Frame
from slipstream.config import Settings
from slipstream.errors import InputError


class SourceSettings(Settings):
    """Which pictures to watch: a recorded clip or a camera."""

    clip: Path | None = Field(default=None, description="Path of a video file.")
    url: str | None = Field(
        default=None, pattern=r"^(rtsp|rtsps|http|https)://", description="RTSP or HTTP MJPEG."
    )
    loop: bool = Field(default=False, description="Start a clip again at its end.")
    pace: Literal["real_time", "fast"] = Field(
        default="real_time", description="Play a clip at its own speed, or every frame at once."
    )
    stall_s: Annotated[float, Field(gt=0, le=300)] = Field(
        default=5.0, description="A camera that sends nothing for so long is reconnected."
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.clip is None) == (self.url is None):
            raise ValueError("give either clip or url")
        if self.url is not None and (self.loop or self.pace == "fast"):
            raise ValueError("loop and pace are for clips")
        return self


@dataclass
class SourceCounters:
    """What happened to the frames of a source since its start.

    Attributes:
        skipped: frames for which there was no time, and those that came in a burst after a stall.
        decode_errors: pictures or clip ends that could not be used.
        reconnects: times that the camera was lost.
        misfit_s: monotonic time of the last picture that had not the calibrated size.
        tried_s: monotonic time of the last attempt to read or connect; old if capture hangs.
    """

    skipped: int = 0
    decode_errors: int = 0
    reconnects: int = 0
    misfit_s: float | None = None
    tried_s: float = field(default_factory=time.monotonic)


class FrameSource(Protocol):
    """An endless or finite stream of frames in order; a live one skips where its reader is slow."""

    counters: SourceCounters

    def frames(self) -> Iterator[Frame | None]:
        """Frames as they come; None about once a second while there is none."""
        ...

    def close(self) -> None:
        """Release the camera or file; `frames` ends."""
        ...


def open_source(settings: SourceSettings, size: tuple[int, int] | None = None) -> FrameSource:
    """Open the source that the settings ask for.

    Args:
        settings: clip or camera.
        size: (width, height) of the calibrated picture, px; None takes any.

    Raises:
        InputError: a clip that is missing, no video, or of another size. An absent camera is
            waited for.
    """
    # Imported here: these modules need this one.
    if settings.clip is not None:
        from edge_daemon.sources.clip import FastClip, open_clip, paced_clip

        reader = open_clip(settings.clip, loop=settings.loop, size=size)
        return FastClip(reader) if settings.pace == "fast" else paced_clip(reader)
    if settings.url is None:
        raise InputError("source", "neither clip nor url", "give one of them")
    from edge_daemon.sources.camera import open_camera

    return open_camera(settings.url, settings.stall_s, size)
