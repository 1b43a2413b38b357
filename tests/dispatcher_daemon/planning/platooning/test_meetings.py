from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.platooning.meetings import Meetings, group_kwh
from dispatcher_daemon.planning.platooning.platoons import platoons_of
from dispatcher_daemon.planning.platooning.segment_order import SegmentOrder
from dispatcher_daemon.planning.platooning.shares import Shares, open_shares
from dispatcher_daemon.planning.platooning.stretches import Traversal
from dispatcher_daemon.planning.roads import planning_speed_mps
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.energy.consumption import ETA_FOLLOWER, ETA_LEADER, drag_saving_kwh
from slipstream.energy.drafting import reductions_at
from slipstream.spacing import CLOSE_GAP_M, planned_gap_m
from slipstream.vehicle_types import PRESETS

SHARES = {"e": Shares(1.0, 4.0), "f": Shares(0.5, 2.0, (2.5, 2.25))}
OTHERS = {"e": Shares(3.0, 5.0, (7.0, 6.0)), "f": Shares(0.25, 1.0)}
WINDOW_S = 3.0
VehicleTraversals = dict[str, list[Traversal]]


def saving_kwh(passages: Sequence[Traversal], shares: Shares, longest: int = 8) -> float:
    """Of all platoons on one segment, formed anew."""
    platoons = platoons_of(passages, WINDOW_S, longest)
    return sum(group_kwh(one, longest, shares, {}, None) for one in platoons)


@st.composite
def traversals_of_vehicles(draw: st.DrawFn) -> list[VehicleTraversals]:
    """Up to eight vehicles close in time on two segments, at times twice on one."""
    count = draw(st.integers(1, 8))
    half_seconds = st.integers(0, 24)
    found = []
    for number in range(count):
        way: VehicleTraversals = {}
        for segment in SHARES:
            entries = sorted(draw(st.lists(half_seconds, max_size=2, unique=True)))
            if entries:
                drives = [draw(st.sampled_from([8.0, 10.0, 12.0])) for _ in entries]
                way[segment] = [
                    (e / 2, e / 2 + d, (number,)) for e, d in zip(entries, drives, strict=True)
                ]
        found.append(way)
    return found


def from_scratch(
    present: Sequence[Mapping[str, Sequence[Traversal]]], longest: int, other: Collection[int]
) -> float:
    """Savings of vehicles on the road, without any bookkeeping; some have other shares."""
    total = 0.0
    for segment, shares in SHARES.items():
        passages = sorted(p for way in present for p in way.get(segment, ()))
        for group in platoons_of(passages, WINDOW_S, longest):
            if len(group) > 1:
                for place, (_, _, (number,)) in enumerate(group):
                    own = OTHERS[segment] if number in other else shares
                    total += own.at(place, len(group))
    return total


@pytest.mark.slow
@given(
    traversals_of_vehicles(),
    st.integers(2, 5),
    st.frozensets(st.integers(0, 7)),
    st.randoms(use_true_random=False),
)
def test_changes_add_up_to_the_whole(
    every: list[VehicleTraversals], longest: int, others: frozenset[int], random: object
) -> None:
    """Vehicles of one type or of two come and go in any order: each change is the difference of
    evaluations from nothing, and a gain that is asked for is the change that then happens.
    """
    assert hasattr(random, "choice")
    meetings = Meetings(SHARES, WINDOW_S, longest, dict.fromkeys(others, OTHERS))
    before = 0.0
    present: list[VehicleTraversals] = []
    for way in [*every, *every, *every]:
        if way in present:
            present.remove(way)
            change = meetings.remove(way)
        else:
            gain = meetings.gain_kwh(way)
            change = meetings.add(way)
            present.append(way)
            assert gain == pytest.approx(change, abs=1e-12)
        if len(present) > 2 and random.choice([True, False]):
            other = present.pop(0)
            change += meetings.remove(other)
        after = from_scratch(present, longest, others)
        assert change == pytest.approx(after - before, abs=1e-9)
        before = after
    on_road = sorted(p for way in present for p in way.get("e", ()))
    assert list(meetings.on("e")) == on_road


@pytest.mark.long
@given(st.data())
def test_what_neighbours_tell_is_what_forming_anew_finds(data: st.DataObject) -> None:
    """Exactly: a plan does not depend on which of the two found a change."""
    seconds = st.tuples(st.integers(0, 40), st.integers(16, 20), st.integers(0, 19))
    shares = SHARES["f"]
    longest = data.draw(st.integers(2, 5))
    order = SegmentOrder(WINDOW_S, lambda group: group_kwh(group, longest, shares, {}, None))
    present: list[Traversal] = []
    for _ in range(data.draw(st.integers(1, 30))):
        off = [p for p in present if data.draw(st.integers(0, 9)) == 0][:2]
        drawn = data.draw(st.lists(seconds, min_size=not off, max_size=2, unique=True))
        on = {(m / 2, (m + d) / 2, (who,)) for m, d, who in drawn} - {*present}
        if not off and not on:
            continue
        change = order.change(off, sorted(on))
        with patch.object(SegmentOrder, "_adjusted", return_value=None):
            assert order.change(off, sorted(on)) == change
        for passage in on:
            assert order.gain_kwh(passage) == order.change((), [passage]).saving_kwh
        before = saving_kwh(present, shares, longest)
        present = sorted({*present, *on} - {*off})
        assert order.apply(off, sorted(on)) == change.saving_kwh
        assert order.passages == present
        after = saving_kwh(present, shares, longest)
        assert change.saving_kwh == pytest.approx(after - before, abs=1e-9)


@pytest.mark.slow
@given(traversals_of_vehicles(), st.data())
def test_what_is_tried_leaves_no_trace(every: list[VehicleTraversals], data: st.DataObject) -> None:
    """After changes that were only tried the roads and all gains are exactly as before, also where
    trying ends by an error.
    """
    meetings = Meetings(SHARES, WINDOW_S, 3)
    for way in every[1:]:
        meetings.add(way)

    def seen() -> list[object]:
        entries = [list(meetings.entries_s(s, -math.inf, math.inf, -1)) for s in SHARES]
        return [*(list(meetings.on(s)) for s in SHARES), *entries, meetings.gains_kwh(every)]

    before = seen()
    with suppress(InterruptedError), meetings.tried():
        for way in every[1:]:
            if data.draw(st.booleans()):
                meetings.remove(way)
        meetings.add(every[0])
        if data.draw(st.booleans()):
            raise InterruptedError
    assert seen() == before


@pytest.mark.parametrize("members", [1, 2, 3, 5])
def test_a_platoon_has_one_leader_and_the_rest_follow(members: int) -> None:
    """m ≥ 2 vehicles within the window save L + (m − 1) F; one alone saves nothing."""
    passages = [(0.5 * n, 10.0 + 0.5 * n, (n,)) for n in range(members)]
    expected = 1.0 + 4.0 * (members - 1) if members > 1 else 0.0
    assert saving_kwh(passages, SHARES["e"]) == pytest.approx(expected)


def test_who_leaves_first_cannot_follow() -> None:
    """A vehicle that enters behind and is due to leave before its leader is no follower, nor is
    one that falls back by more than the window.
    """
    leader = (0.0, 10.0, (0,))
    assert saving_kwh([leader, (1.0, 11.0, (1,))], SHARES["e"]) == 5.0
    assert saving_kwh([leader, (1.0, 9.9, (1,))], SHARES["e"]) == 0.0
    assert saving_kwh([leader, (1.0, 13.1, (1,))], SHARES["e"]) == 0.0


def test_the_window_counts_from_the_leader() -> None:
    """Vehicles 2 s apart each: the third is too far behind the first, and leads the fourth."""
    passages = [(2.0 * n, 10.0 + 2.0 * n, (n,)) for n in range(4)]
    assert saving_kwh(passages, SHARES["e"]) == pytest.approx(2 * 5.0)


def test_only_open_segments_have_shares(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
) -> None:
    """Shares are the leader's and a follower's drag savings; a closed gate has none."""
    problem, snapshot = town(["33"], [{}], open_share=0.5)
    shares = open_shares(problem, snapshot)
    assert set(shares) == {name for name, t in snapshot.segments.items() if t.open}
    assert 0 < len(shares) < len(snapshot.segments)
    for name, share in shares.items():
        length = problem.network.segments[name].length_m
        speed = snapshot.segments[name].speed_mps
        assert share.leader_kwh == drag_saving_kwh(length, speed, ETA_LEADER, problem.vehicle)
        assert share.follower_kwh == drag_saving_kwh(length, speed, ETA_FOLLOWER, problem.vehicle)
        assert 0 < share.leader_kwh < share.follower_kwh
        assert share.longer_kwh is None


@pytest.mark.parametrize(
    ("members", "expected_kwh"),
    [
        (2, 0.0468026464650489),
        (3, 0.08424476363708804),
        (4, 0.12168688080912715),
        (6, 0.1965711151532054),
    ],
)
def test_by_the_papers_law_platoons_save_what_they_did(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
    members: int,
    expected_kwh: float,
) -> None:
    """Figures of the version that knew no other law, on all open segments together."""
    problem, snapshot = town(["33"], [{}], open_share=0.5)
    passages = [(0.1 * n, 30.0 + 0.1 * n, (n,)) for n in range(members)]
    shares = open_shares(problem, snapshot).values()
    assert sum(saving_kwh(passages, s) for s in shares) == expected_kwh


def test_measured_shares_count_the_gap_at_the_planning_speed(
    town: Callable[..., tuple[RoutingProblem, TrafficSnapshot]],
) -> None:
    """A van saves by the gap that its brakes allow, and less by a wider advised one. The paper's
    law knows no gap up to the largest for which its reductions are credited, and nothing beyond.
    """
    problem, snapshot = town(["33"], [{}])
    van = PRESETS["van"].profile
    near, wide = (
        open_shares(problem, snapshot, van),
        open_shares(replace(problem, advised_gap_m=5.0), snapshot, van),
    )
    for name, shares in near.items():
        speed = planning_speed_mps(problem.network.segments[name], snapshot.segments[name], van)
        length = problem.network.segments[name].length_m
        gap_m = planned_gap_m(speed, problem.advised_gap_m, van.braking)
        eta = reductions_at("van", gap_m)
        expected = [drag_saving_kwh(length, speed, e, van.physics) for e in eta]
        assert shares == Shares(expected[0], expected[1])
        assert wide[name].leader_kwh < shares.leader_kwh
    truck = PRESETS["truck_40t"].profile
    assert all(s.longer_kwh is not None for s in open_shares(problem, snapshot, truck).values())
    far = replace(problem, advised_gap_m=CLOSE_GAP_M)
    assert open_shares(far, snapshot) == open_shares(problem, snapshot)
    farther = replace(problem, advised_gap_m=CLOSE_GAP_M + 0.1)
    assert all(s == Shares(0.0, 0.0) for s in open_shares(farther, snapshot).values())
