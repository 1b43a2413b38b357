"""Vehicles that break down in their lane: what makes an hour of a calm road turbulent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field, model_validator

from slipstream.config import Settings
from slipstream.errors import InputError
from slipstream.messages import Identifier
from slipstream.roads import RoadNetwork

_RUN_UP_M: Final = 400.0
"""From the segment's beginning; braking from 30 m/s at the comfortable 2.5 m/s² takes 180 m."""
_BEFORE_END_M: Final = 50.0
_STREAM: Final = 4000
"""No other draw of a seed has it: numpy takes [seed, n] and [seed, n, 0] for the same."""

Seconds = Annotated[float, Field(ge=0, le=86400, allow_inf_nan=False)]


class Breakdown(Settings):
    """A car that breaks down in the rightmost lane of one of some segments."""

    name: Identifier
    segments: Annotated[tuple[Identifier, ...], Field(min_length=1)] = Field(
        description="One of them is drawn, each with the same probability."
    )
    begin_s: tuple[Seconds, Seconds] = Field(
        description="It enters the segment between these times, s since midnight."
    )
    duration_s: tuple[Seconds, Seconds] = Field(
        serialization_alias="lasts_s", description="Shortest and longest time until it drives on."
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for key in ("begin_s", "duration_s"):
            low, high = getattr(self, key)
            if low > high:
                raise ValueError(f"{key}: {low:g} to {high:g} runs backwards")
        return self


@dataclass(frozen=True)
class DrawnBreakdown:
    """One that was drawn."""

    name: str
    segment: str
    at_m: float
    begin_s: float
    end_s: float


def draw_breakdowns(
    breakdowns: Sequence[Breakdown], network: RoadNetwork, seed: int, source: str | Path
) -> tuple[DrawnBreakdown, ...]:
    """Draw a day's breakdowns in the order of time; each has a random stream of its own. Raises
    InputError: a name twice, a segment that the network has not, or one too short to stop on.
    """
    names = Counter(breakdown.name for breakdown in breakdowns)
    twice = next((name for name, count in names.items() if count > 1), None)
    if twice is not None:
        key = f"breakdowns.{twice}"
        raise InputError(source, "two breakdowns with this name", "rename one", key=key)
    drawn = []
    for index, breakdown in enumerate(breakdowns):
        for name in breakdown.segments:
            segment = network.segments.get(name)
            key = f"breakdowns.{breakdown.name}"
            if segment is None:
                problem = f"no segment {name!r} in net {network.name!r}"
                raise InputError(source, problem, "name one of the net", key=key)
            if segment.length_m < _RUN_UP_M + 2 * _BEFORE_END_M:
                problem = f"{name} is {segment.length_m:.0f} m long"
                min_length_m = _RUN_UP_M + 2 * _BEFORE_END_M
                raise InputError(
                    source, problem, f"name one of {min_length_m:g} m and more", key=key
                )
        rng = np.random.default_rng([seed, _STREAM, index])
        name = breakdown.segments[rng.integers(len(breakdown.segments))]
        length_m = network.segments[name].length_m
        at_m = rng.uniform(_RUN_UP_M, length_m - _BEFORE_END_M)
        begin_s = rng.uniform(*breakdown.begin_s)
        end_s = begin_s + rng.uniform(*breakdown.duration_s)
        drawn.append(
            DrawnBreakdown(breakdown.name, name, round(at_m, 1), round(begin_s, 1), round(end_s, 1))
        )
    return tuple(sorted(drawn, key=lambda standing: (standing.begin_s, standing.name)))
