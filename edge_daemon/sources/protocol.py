"""What a source of frames is, and its counters."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

from edge_daemon.frame import Frame


@dataclass
class SourceCounters:
    """What happened to the frames of a source since its start.

    Attributes:
        skipped: frames for which there was no time, and those that came in a burst after a stall.
        decode_errors: frames or clip ends that could not be used.
        reconnects: times that the camera was lost.
        gap_s: time that a clip's time stamps leave out between its frames.
        size_mismatch_s: monotonic time of the last frame that had not the calibrated size.
        tried_s: monotonic time of the last attempt to read or connect; old if capture hangs.
    """

    skipped: int = 0
    decode_errors: int = 0
    reconnects: int = 0
    gap_s: float = 0.0
    size_mismatch_s: float | None = None
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
