"""Who drives with whom: rewards of shared segments, what a meeting saves, the platoons that exact
times give, and vehicles of earlier cycles that are still on the road."""

from __future__ import annotations

from dispatcher_daemon.platooning.meetings import (
    Meetings,
    Passing,
    Passings,
    Shares,
    clusters,
    open_shares,
    passings,
    saving_kwh,
)
from dispatcher_daemon.platooning.platoons import (
    Passage,
    Place,
    Timed,
    drag_reductions,
    form_platoons,
    platoons_of,
)
from dispatcher_daemon.platooning.rewards import JudgedPair, judge_pairs, rewards
from dispatcher_daemon.platooning.vehicles_on_road import (
    RoadUser,
    joined_segments,
    on_road,
    passings_on_road,
)

__all__ = [
    "JudgedPair",
    "Meetings",
    "Passage",
    "Passing",
    "Passings",
    "Place",
    "RoadUser",
    "Shares",
    "Timed",
    "clusters",
    "drag_reductions",
    "form_platoons",
    "joined_segments",
    "judge_pairs",
    "on_road",
    "open_shares",
    "passings",
    "passings_on_road",
    "platoons_of",
    "rewards",
    "saving_kwh",
]
