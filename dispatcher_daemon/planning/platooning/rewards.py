"""Platooning rewards s_{e,k,l} on road segments, gated and synchronised, each with its reason."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from dispatcher_daemon.forms import ArcReward, RoutingProblem
from dispatcher_daemon.planning.platooning.expected import Approach, ExpectedDrafting
from dispatcher_daemon.planning.platooning.reductions import planned_reductions
from dispatcher_daemon.planning.platooning.vehicles_on_road import counted_drafting
from dispatcher_daemon.planning.roads import RoutedArc, planning_speed_mps
from dispatcher_daemon.traffic import SegmentTraffic, TrafficSnapshot
from slipstream.energy.consumption import drag_saving_kwh
from slipstream.roads import Segment
from slipstream.vehicle_types import RoutingProfile


@dataclass(frozen=True)
class JudgedPair:
    """The reward of two arcs of two vehicles on one segment, and the reason where it is 0.

    Attributes:
        first: index of the arc of vehicle k.
        second: index of the arc of vehicle l.
        saving_kwh: s_{e,k,l}; 0 with a reason.
        reason: why it is 0; None where it is not.
    """

    segment: str
    first: int
    second: int
    first_entry_s: float
    second_entry_s: float
    saving_kwh: float
    reason: str | None


def pair_saving_kwh(
    problem: RoutingProblem,
    segment: Segment,
    traffic: SegmentTraffic,
    leader: RoutingProfile,
    follower: RoutingProfile,
) -> float:
    """Saving of a platoon of two on a segment, whatever gate and timing, kWh.

    The paper's form rewards pairs only, so in it a third vehicle saves as behind one leader too.
    """

    def saving_kwh(of: RoutingProfile, number: int) -> float:
        speed_mps = planning_speed_mps(segment, traffic, of)
        eta = planned_reductions(problem, of, speed_mps).at(number, 2)
        return drag_saving_kwh(segment.length_m, speed_mps, eta, of.physics)

    return saving_kwh(leader, 0) + saving_kwh(follower, 1)


def judge_pairs(
    problem: RoutingProblem,
    arcs: Sequence[RoutedArc],
    snapshot: TrafficSnapshot,
    sync_window_s: float,
) -> Iterator[JudgedPair]:
    """Judge every pair of arcs of two vehicles that share a watched segment (paper section III-A).

    Under the objective "energy" a reward also needs certain departures, and the two must be due to
    leave the segment as a platoon: what it counts comes about. Where the problem's drafting is
    "expected", it counts the share of the segment on which the two are expected to be close.
    """
    expected = counted_drafting(problem, snapshot)
    users: dict[str, list[tuple[int, float]]] = {}
    for index, arc in enumerate(arcs):
        for name, entry in arc.entries_s().items():
            if snapshot.segments[name].reason != "unwatched":
                users.setdefault(name, []).append((index, entry))
    for name in sorted(users):
        segment, traffic = problem.network.segments[name], snapshot.segments[name]
        for position, (first, first_entry) in enumerate(users[name]):
            for second, second_entry in users[name][position + 1 :]:
                if arcs[first].vehicle == arcs[second].vehicle:
                    continue
                difference_s = abs(first_entry - second_entry)
                reason = None
                if not traffic.open:
                    reason = f"gate closed ({traffic.reason})"
                elif difference_s > sync_window_s:
                    reason = (
                        f"entry times {difference_s:.1f} s apart, more than {sync_window_s:g} s"
                    )
                elif problem.objective == "energy":
                    reason = _doubt(segment.id, arcs[first], arcs[second], sync_window_s)
                saving = 0.0
                if reason is None:
                    # Who enters first leads.
                    pair = (first, second) if first_entry <= second_entry else (second, first)
                    leader, follower = (problem.profile_of(arcs[i].vehicle) for i in pair)
                    saving = pair_saving_kwh(problem, segment, traffic, leader, follower)
                    if expected is not None:
                        # The leader saves as long as its only follower is close.
                        saving *= expected.shares(
                            tuple(_approach(expected, arcs[i], name) for i in pair)
                        )[1]
                yield JudgedPair(name, first, second, first_entry, second_entry, saving, reason)


def _approach(expected: ExpectedDrafting, arc: RoutedArc, segment: str) -> Approach:
    # Arcs begin at stops, where vehicles stand.
    return expected.of_leg(arc.vehicle, 0, arc.leg)[arc.leg.path.index(segment)]


def _doubt(segment: str, first: RoutedArc, second: RoutedArc, sync_window_s: float) -> str | None:
    """Why two arcs whose entries are close may make no platoon on a segment; None: they do."""
    for arc in (first, second):
        if not arc.exact:
            return f"when {arc.vehicle} leaves {arc.leg.start} depends on the stops before it"
    entries_s = first.entries_s()[segment] - second.entries_s()[segment]
    leavings_s = first.leavings_s()[segment] - second.leavings_s()[segment]
    return apart_at_the_end(entries_s, leavings_s, sync_window_s)


def apart_at_the_end(entries_s: float, leavings_s: float, sync_window_s: float) -> str | None:
    """Why two that enter a segment together do not leave it as a platoon; None: they do.

    Args:
        entries_s: difference of their entries.
    """
    if entries_s * leavings_s < 0:
        return (
            f"who enters first, by {abs(entries_s):.2f} s, is due to leave last, "
            f"by {abs(leavings_s):.2f} s"
        )
    if abs(leavings_s) > sync_window_s:
        apart = f"{abs(leavings_s):.1f} s apart, more than {sync_window_s:g} s"
        return f"they are due to leave it {apart}"
    return None


def rewards(pairs: Sequence[JudgedPair]) -> tuple[ArcReward, ...]:
    """The rewards that are not zero, for `ArcProblem`."""
    return tuple(
        ArcReward(p.first, p.second, p.segment, p.saving_kwh) for p in pairs if p.saving_kwh > 0
    )
