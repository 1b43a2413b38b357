"""Settings of a StreetDrive clip, checked."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive.calibration import MonitoredSegment
from slipstream_lab.simulation.streetdrive.rendering import CLEAR, Conditions
from slipstream_lab.simulation.streetdrive.traffic import SCENARIOS

SEGMENT_NEAR_M, SEGMENT_FAR_M = 20.0, 80.0

_SEGMENT_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


@dataclass(frozen=True)
class ClipSettings:
    """What to render.

    Args:
        reverse_segment_id: identity of the outgoing lanes; monitored when it is given, and in the
            `mixed` scenario always (there it is "departure" unless given).
        conditions: weather, hour and the camera's state; the truth does not depend on them.

    Raises:
        InputError: a value is out of range.
    """

    seconds: float = 30.0
    fps: float = 30.0
    scenario: str = "stable"
    seed: int = 1
    segment_id: str = "approach"
    reverse_segment_id: str | None = None
    conditions: Conditions = CLEAR

    def __post_init__(self) -> None:
        def refuse(key: str, problem: str, mend: str) -> None:
            raise InputError("clip settings", problem, mend, key=key)

        if not (math.isfinite(self.seconds) and 0.1 <= self.seconds <= 3600):
            refuse("seconds", f"{self.seconds} is out of range", "give 0.1 to 3600")
        if not (math.isfinite(self.fps) and 5 <= self.fps <= 60):
            refuse("fps", f"{self.fps} is out of range", "give 5 to 60")
        if self.scenario not in SCENARIOS:
            refuse(
                "scenario", f"{self.scenario!r} is unknown", "give one of " + ", ".join(SCENARIOS)
            )
        if self.seed < 0:
            refuse("seed", f"{self.seed} is negative", "give 0 or more")
        for key, value in (
            ("segment_id", self.segment_id),
            ("reverse_segment_id", self.reverse_segment_id),
        ):
            if value is not None and not _SEGMENT_ID.fullmatch(value):
                refuse(key, f"{value!r} is no identity", "use letters, digits, '_', '-' and '.'")
        if self.reverse_segment_id == self.segment_id:
            refuse("reverse_segment_id", "equals segment_id", "give another one")

    @property
    def frames(self) -> int:
        """Number of frames of the clip."""
        return max(1, round(self.seconds * self.fps))

    @property
    def segments(self) -> tuple[MonitoredSegment, ...]:
        """The monitored stretches."""
        incoming = MonitoredSegment(self.segment_id, -1, SEGMENT_NEAR_M, SEGMENT_FAR_M)
        reverse = self.reverse_segment_id
        if reverse is None and self.scenario == "mixed":
            reverse = "departure"
        if reverse is None:
            return (incoming,)
        return (incoming, MonitoredSegment(reverse, 1, SEGMENT_NEAR_M, SEGMENT_FAR_M))
