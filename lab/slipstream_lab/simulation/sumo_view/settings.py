"""Settings of a SUMO view."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from slipstream.errors import InputError
from slipstream_lab.simulation.rsus import RsuSettings


@dataclass(frozen=True)
class SumoClipSettings:
    """What to render.

    Args:
        rsu_id: which RSU of the file; None: it has one only.
        begin_s: simulated time of the first frame; what comes before fills the road.

    Raises:
        InputError: a value is out of range.
    """

    net: Path
    routes: tuple[Path, ...]
    rsu: Path
    additional: tuple[Path, ...] = ()
    seconds: float = 30.0
    fps: float = 30.0
    begin_s: float = 120.0
    seed: int = 1
    rsu_id: str | None = None
    camera: RsuSettings | None = None
    start_s: float = 0.0

    def __post_init__(self) -> None:
        for key, value, low, high in (
            ("seconds", self.seconds, 0.1, 3600.0),
            ("fps", self.fps, 5.0, 60.0),
            ("begin", self.begin_s, self.start_s, 604800.0),
            ("seed", float(self.seed), 0.0, 2.0**31 - 1),
        ):
            if not (math.isfinite(value) and low <= value <= high):
                raise InputError(
                    "clip settings",
                    f"{value:.12g} is out of range",
                    f"give {low:.12g} to {high:.12g}",
                    key=key,
                )

    @property
    def frames(self) -> int:
        """Number of frames of the clip."""
        return max(1, round(self.seconds * self.fps))
