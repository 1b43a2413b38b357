"""Vehicles that follow plans of earlier cycles as possible platoon partners."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from dispatcher_daemon.fleet import Commitment, Passage, RoadUser
from dispatcher_daemon.forms import RoutingProblem
from dispatcher_daemon.planning.platooning.expected import ExpectedDrafting, LegFrom
from dispatcher_daemon.planning.platooning.meetings import Traversals
from dispatcher_daemon.planning.platooning.platoons import Place
from dispatcher_daemon.planning.platooning.shares import Shares
from dispatcher_daemon.planning.platooning.stretches import Traversal
from dispatcher_daemon.traffic import TrafficSnapshot
from slipstream.messages import PlannedSegment


def expected_drafting(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    commitments: Iterable[Commitment] = (),
    users: Iterable[RoadUser] = (),
) -> ExpectedDrafting | None:
    """What is expected of platoons, whatever the objective; None: they are close from where they
    form. See `RoutingProblem.drafting`.

    Args:
        commitments: of vehicles whose routes may begin under way.
        users: vehicles on the road that the cycle does not plan.
    """
    if problem.drafting == "ideal":
        return None
    begun = {own.vehicle: _begun_leg(own) for own in commitments if own.moving is not None}
    known = {(user.vehicle, number): leg for user in users for number, leg in user.legs.items()}
    return ExpectedDrafting(problem, snapshot, begun, known)


def counted_drafting(
    problem: RoutingProblem,
    snapshot: TrafficSnapshot,
    commitments: Iterable[Commitment] = (),
    users: Iterable[RoadUser] = (),
) -> ExpectedDrafting | None:
    """The same, as the objective counts it: by the paper's they are close from where they form."""
    if problem.objective == "paper":
        return None
    return expected_drafting(problem, snapshot, commitments, users)


def _begun_leg(own: Commitment) -> LegFrom:
    """What a vehicle that moves has done of its leg, up to its segment, by its present plan."""
    here, time_ns = own.legs[0].path[0], 0 if own.moving is None else own.moving.time_ns
    planned = own.plan.segments
    found = [
        (abs(one.entry_ns - time_ns), at) for at, one in enumerate(planned) if one.segment == here
    ]
    if not found:
        return own.node, (here,)
    _, at = min(found)
    leg = planned[at].leg
    return own.plan.stops[leg].node, tuple(p.segment for p in planned[: at + 1] if p.leg == leg)


def traversals_on_road(
    users: Sequence[RoadUser],
    shares: Mapping[str, Shares],
    expected: ExpectedDrafting | None = None,
) -> list[Traversals]:
    """Their passages of open segments, under negative vehicle numbers; the fleet's are ≥ 0."""
    found: list[Traversals] = []
    approaches = None if expected is None else expected.on_road
    for number, user in enumerate(users, 1):
        traversals: dict[str, list[Traversal]] = {}
        for segment, (entry, leaving, passage) in user.passages():
            if segment in shares:
                key = (-number,) if approaches is None else (-number, approaches[passage])
                traversals.setdefault(segment, []).append((entry, leaving, key))
        found.append(traversals)
    return found


def joined_segments(
    users: Sequence[RoadUser], places: Mapping[Passage, Place], gap_m: float
) -> list[tuple[str, PlannedSegment]]:
    """Vehicle and segment, with its place in a platoon, of each passage that has one."""
    return [
        (
            user.vehicle,
            planned.model_copy(
                update={
                    "platoon": places[passage].platoon,
                    "place": places[passage].number,
                    "gap_m": gap_m if places[passage].number > 0 else None,
                    "drafting_share": places[passage].share,
                }
            ),
        )
        for user in users
        for passage, planned in user.ahead
        if passage in places
    ]
