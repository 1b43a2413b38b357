"""Platooning: rewards, savings of meetings, platoons by exact times, vehicles on the road."""

from __future__ import annotations

from dispatcher_daemon.planning.platooning.book import MeetingBook
from dispatcher_daemon.planning.platooning.expected import Approach, ExpectedDrafting
from dispatcher_daemon.planning.platooning.meetings import Meetings, Traversals
from dispatcher_daemon.planning.platooning.platoons import (
    Place,
    TimedPassage,
    drag_reductions,
    form_platoons,
    platoons_of,
)
from dispatcher_daemon.planning.platooning.rewards import (
    JudgedPair,
    apart_at_the_end,
    judge_pairs,
    pair_saving_kwh,
    rewards,
)
from dispatcher_daemon.planning.platooning.segment_order import Change
from dispatcher_daemon.planning.platooning.shares import Shares, open_shares
from dispatcher_daemon.planning.platooning.stretches import Traversal
from dispatcher_daemon.planning.platooning.vehicles_on_road import (
    counted_drafting,
    expected_drafting,
    joined_segments,
)

__all__ = [
    "Approach",
    "Change",
    "ExpectedDrafting",
    "JudgedPair",
    "MeetingBook",
    "Meetings",
    "Place",
    "Shares",
    "TimedPassage",
    "Traversal",
    "Traversals",
    "apart_at_the_end",
    "counted_drafting",
    "drag_reductions",
    "expected_drafting",
    "form_platoons",
    "joined_segments",
    "judge_pairs",
    "open_shares",
    "pair_saving_kwh",
    "platoons_of",
    "rewards",
]
