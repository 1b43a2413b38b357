"""The weather benchmark: what must not be is counted, and the same traffic is in all conditions."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from slipstream.messages import Estimate, KinematicFeatures, SegmentState, UnknownReason
from slipstream_lab.benchmarks.accuracy.clips import WEATHER
from slipstream_lab.benchmarks.accuracy.weather import flags_of, table
from slipstream_lab.research.perception import TrackComparison
from slipstream_lab.research.perception.score import TrueBoxes
from slipstream_lab.simulation.ground_truth import TrueWindow

TRUE = TrueWindow(15.0, 0.0, 0.05, 1.0, 0.2, 20.0, 6, 1, False)
FEATURES = KinematicFeatures(
    mean_speed_mps=Estimate(value=15.0),
    mean_acceleration_mps2=Estimate(value=0.0),
    density_veh_per_m=Estimate(value=0.05),
    speed_std_mps=Estimate(value=1.0),
    acceleration_variance_m2ps4=Estimate(value=0.2),
)


def window(
    y_e: Literal[0, 1] | None, true: Literal[0, 1], reason: UnknownReason | None = None
) -> tuple[SegmentState, TrueWindow]:
    """A flag beside the true one."""
    state = SegmentState(
        rsu="rsu",
        segment="approach",
        sequence=1,
        time_ns=1,
        window_s=10.0,
        features=None if y_e is None else FEATURES,
        y_e=y_e,
        reason=(reason or "blind") if y_e is None else None,
        vehicles=0,
        frames=300,
        coverage=1.0,
    )
    return state, replace(TRUE, y_e=true)


def test_flags_are_counted_against_the_truth() -> None:
    """Two windows are unknown; one of four flags is stable in turbulence, and one the reverse."""
    boxes = TrueBoxes(np.arange(4), np.zeros(4, dtype=np.int64), np.array([1, 1, 1, 0], dtype=bool))
    none = np.zeros(0)
    clip = TrackComparison([], boxes, none, none.astype(bool), none.astype(np.int64), [])
    windows = [
        *(window(1, 1), window(0, 0), window(1, 0), window(0, 1)),
        *(window(None, 1), window(None, 0, "too_few_vehicles")),
    ]
    flags = flags_of(windows, [clip])
    assert (flags.windows, flags.known, flags.right, flags.wrongly_stable) == (6, 4, 2, 1)
    assert flags.unknown == {"blind": 1, "too_few_vehicles": 1}
    assert flags.followed == 0.75
    row = table({"night": flags}).splitlines()[-1]
    cells = ["night", "75.0%", "6", "67%", "50%", "1", "blind 1, too_few_vehicles 1"]
    assert [cell.strip() for cell in row.strip("|").split("|")] == cells


def test_all_conditions_have_the_same_traffic_and_folders_of_their_own() -> None:
    """Only so are their rows comparable."""
    clips = [clip for of_one in WEATHER.values() for clip in of_one]
    assert len({clip.name for clip in clips}) == len(clips)
    seeds = {tuple(clip.seed for clip in of_one) for of_one in WEATHER.values()}
    assert len(seeds) == 1
    assert {(clip.world, clip.traffic, clip.seconds) for clip in clips} == {
        ("streetdrive", "mixed", 20)
    }
