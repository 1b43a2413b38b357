"""Vehicles that follow plans of earlier cycles, as possible platoon partners."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.fleet.commitments import Commitment
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.planning.platooning.expected import ExpectedDrafting, LegFrom
from dispatcher_daemon.planning.platooning.meetings import Traversals
from dispatcher_daemon.planning.platooning.platoons import Passage, Place, TimedPassage
from dispatcher_daemon.planning.platooning.shares import Shares
from dispatcher_daemon.planning.platooning.stretches import Traversal
from dispatcher_daemon.traffic.snapshot import TrafficSnapshot
from slipstream.messages import PlannedSegment, VehiclePlan


@dataclass(frozen=True)
class RoadUser:
    """A vehicle that drives by an earlier plan.

    Attributes:
        vehicle: of the fleet; the cycle does not plan it.
        now_ns: the cycle's start, UTC.
        ahead: remaining segments in order: passage of its plan and segment, with times in UTC.
        legs: of its plan by number: node of the place that it left, and path.
        cycle: of its plan.
        late_s: by how much it is behind its plan.
    """

    vehicle: str
    now_ns: int
    ahead: tuple[tuple[Passage, PlannedSegment], ...]
    legs: Mapping[int, tuple[str, tuple[str, ...]]] = field(default_factory=dict)
    cycle: int = 0
    late_s: float = 0.0

    def passages(self) -> Iterator[tuple[str, TimedPassage[Passage]]]:
        """Each segment with its passage, times in s after the cycle's start."""
        for passage, planned in self.ahead:
            entry, leaving = planned.entry_ns - self.now_ns, planned.exit_ns - self.now_ns
            yield planned.segment, (1e-9 * entry, 1e-9 * leaving, passage)


def on_road(
    plans: Iterable[VehiclePlan], now_ns: int, late_s: Mapping[str, float] | None = None
) -> tuple[RoadUser, ...]:
    """The vehicles of earlier plans that still have segments to enter after a moment.

    Args:
        plans: at most one a vehicle.
        now_ns: a cycle's start, UTC.
        late_s: by how much vehicles are behind their plans.
    """
    late = late_s or {}
    users = []
    for plan in sorted(plans, key=lambda plan: plan.vehicle):
        late_by_s = late.get(plan.vehicle, 0.0)
        shifts_ns = _shifts_ns(plan, round(1e9 * late_by_s), now_ns)
        paths: dict[int, list[str]] = {}
        ahead = []
        for planned in plan.segments:
            shift_ns, path = shifts_ns[planned.leg], paths.setdefault(planned.leg, [])
            passage = plan.vehicle, planned.leg, len(path)
            path.append(planned.segment)
            if planned.entry_ns + shift_ns > now_ns:
                times = {
                    "entry_ns": planned.entry_ns + shift_ns,
                    "exit_ns": planned.exit_ns + shift_ns,
                }
                ahead.append((passage, planned.model_copy(update=times)))
        if ahead:
            legs = {leg: (plan.stops[leg].node, tuple(path)) for leg, path in paths.items()}
            user = RoadUser(plan.vehicle, now_ns, tuple(ahead), legs, plan.cycle, late_by_s)
            users.append(user)
    return tuple(users)


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
    """What a vehicle that moves has done of its leg by its present plan, up to its segment; that
    segment alone where the plan does not have it.
    """
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


def _shifts_ns(plan: VehiclePlan, late_ns: int, now_ns: int) -> list[int]:
    """By how much a vehicle is behind its plan on each leg: a wait that lies ahead makes up for it,
    and lets nobody leave early.
    """
    shifts, shift = [], late_ns
    for stop in plan.stops[:-1]:
        if stop.wait_s > 0 and stop.departure_ns > now_ns:
            shift = max(0, shift - round(1e9 * stop.wait_s))
        shifts.append(shift)
    return shifts


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
