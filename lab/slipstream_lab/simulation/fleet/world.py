"""The fleet in the running simulation: each vehicle stands, drives and serves as it is advised."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import takewhile
from typing import Final, Protocol

import libsumo

from slipstream.energy.consumption import ETA_ALONE
from slipstream.messages import (
    DriverReport,
    PlannedStop,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
)
from slipstream.spacing import CLOSE_GAP_M
from slipstream.vehicle_types import VehicleType
from slipstream_lab.simulation.fleet.actuation import Driver, shape_fleet
from slipstream_lab.simulation.fleet.brakes import Reality
from slipstream_lab.simulation.fleet.drafting import Cause, RoadsideGates, drafting, why_missed
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg, LegMeasurement, free_s
from slipstream_lab.simulation.fleet.safety import SafetyWatch
from slipstream_lab.simulation.fleet.sensing import PREFIX, acceleration_ahead, sense, standing
from slipstream_lab.simulation.fleet.van import DrivenWay, SimulatedVan, planned_leg
from slipstream_lab.simulation.sumo.session import SumoSession

# The IDM approaches the end of a leg asymptotically: the last metres would take minutes.
_ARRIVED_M: Final = 5.0
_ARRIVED_MPS: Final = 1.0
_TELL_S: Final = 1.0
_SOON_NS: Final = 200_000_000


class Agents(Protocol):
    """The vehicles' agents, in this process or over the bus."""

    def advise(self, sensing: VehicleSensing) -> VehicleAdvice | None:
        """The advice that holds; None: none does."""
        ...

    def report(self, report: DriverReport) -> None:
        """A driver says something."""
        ...

    def plan(self, vehicle: str, cycle: int) -> VehiclePlan | None:
        """A plan that the vehicle has been sent, for its navigation."""
        ...

    def is_due(self, vehicle: str) -> bool:
        """Whether there is something new for a vehicle that stands."""
        ...


class FleetWorld:
    """A simulation with the fleet in it.

    Args:
        kind: type of all vehicles.
        service_s: time that a stop takes, by its id; None: as its plan has it.
        reality: of vehicles and sensors; None: all are ideal.

    Attributes:
        safety: what has happened, and how near to each other vehicles came.
        disengagements: of platoons in close gaps that parted because the state of the segment was
            turbulent.
        longest_silence_s: for how long a partner had been without advice, and so silent, at most,
            while a vehicle still followed it closely.
    """

    def __init__(
        self,
        session: SumoSession,
        places: Mapping[str, str],
        kind: VehicleType,
        lengths_m: Mapping[str, float],
        agents: Agents,
        gates: RoadsideGates,
        service_s: Callable[[str], float | None],
        step_s: float,
        clock_ns: Callable[[], int],
        look_s: float,
        pace: float = 1.0,
        reality: Reality | None = None,
    ) -> None:
        self._session, self._lengths_m, self._agents = session, lengths_m, agents
        self._gates, self._service_s, self._step_s = gates, service_s, step_s
        self._clock_ns = clock_ns
        self._look_ns, self._pace = round(look_s * 1e9), pace
        self._physics, self._laws = kind.profile.physics, dict.fromkeys(places, kind.drafting)
        self._top_mps = kind.max_speed_mps or math.inf
        shape_fleet(kind, pace)
        real = {} if reality is None else {name: reality.vehicle(name) for name in places}
        self._vans = {
            name: SimulatedVan(segment, real=real.get(name))
            for name, segment in sorted(places.items())
        }
        self.safety = SafetyWatch(step_s)
        self._sensed: dict[str, VehicleSensing] = {}
        self._following: dict[str, bool] = {}
        self.disengagements = 0
        self.begun_s: dict[str, float] = {}
        self.again: list[str] = []
        self.longest_silence_s = 0.0
        self._advice: dict[str, VehicleAdvice] = {}
        self.tours_finished = 0

    @property
    def tours_begun(self) -> int:
        """Tours so far."""
        return sum(van.tour + 1 for van in self._vans.values())

    @property
    def unfinished(self) -> int:
        """Vehicles on the road, or waiting to get onto it."""
        return sum(van.way is not None for van in self._vans.values())

    @property
    def driven(self) -> int:
        """Vehicles that have come onto the road at all."""
        return sum(van.measured is not None or van.leg > 0 for van in self._vans.values())

    @property
    def on_road(self) -> int:
        """Vehicles on the road."""
        return sum(van.measured is not None for van in self._vans.values())

    def step(self) -> list[DrivenLeg]:
        """Move by one step; the legs that ended in it. Raises InputError: SUMO refuses a vehicle
        or a route.
        """
        now_s, now_ns = self._session.time_s, self._clock_ns()
        for name, van in self._vans.items():
            if van.way is None:
                self._stand(name, van, now_s, now_ns)
        self._drive(now_ns)
        drafts = drafting(self._sensed, self._following, self._gates, self._laws)
        self._session.advance()
        self._look()
        after_s, gone = self._session.time_s, set(libsumo.simulation.getArrivedIDList())
        ended = []
        for name, van in self._vans.items():
            if van.way is None or van.measured is None:
                continue
            sumo = van.driver.name
            if sumo not in gone and not _is_placed(sumo):
                continue
            if sumo not in gone:
                speed_mps = float(libsumo.vehicle.getSpeed(sumo))
                self.safety.drove(name, speed_mps)
                place = drafts.places.get(name)
                van.measured.take(
                    speed_mps,
                    float(libsumo.vehicle.getDistance(sumo)),
                    drafts.eta.get(name, ETA_ALONE),
                    self._step_s,
                    place=place,
                    turbulent=name in drafts.turbulent,
                    missed=None if place is not None else self._why_missed(name, van.way),
                )
                van.way.at = van.way.behind + max(0, libsumo.vehicle.getRouteIndex(sumo))
                if self._has_arrived(sumo, van.way, speed_mps):
                    libsumo.vehicle.remove(sumo)
                    ended.append(self._end(name, van, after_s))
            else:
                ended.append(self._end(name, van, after_s))
        self._admit(after_s)
        return ended

    def _look(self) -> None:
        simulation = libsumo.simulation
        self.safety.look(
            ((one.collider, one.victim) for one in simulation.getCollisions()),
            simulation.getEmergencyStoppingVehiclesIDList(),
            simulation.getStartingTeleportIDList(),
            simulation.getDepartedIDList(),
        )

    def _stand(self, name: str, van: SimulatedVan, now_s: float, now_ns: int) -> None:
        """Serve; ask the agent; leave when it says so."""
        if van.serves is not None and now_s >= max(van.serves[1], van.told_s + _TELL_S):
            # Said again until the agent has taken it in: it may have been restarted.
            self._agents.report(
                DriverReport(
                    vehicle=name, time_ns=now_ns, event="served", stop=van.serves[0], reason=None
                )
            )
            van.ready_s = max(van.ready_s, van.serves[1])
            van.told_s, van.look_ns = now_s, now_ns
        if now_ns < van.look_ns and not self._agents.is_due(name):
            return
        advice = self._agents.advise(standing(name, van.segment, now_ns))
        van.look_ns = now_ns + self._look_ns
        if advice is None or advice.cycle is None or advice.leg is None:
            return
        if advice.mode != "none" or advice.reason is not None or advice.time_ns < van.since_ns:
            van.look_ns = now_ns + _SOON_NS  # it was for the road: over the bus it comes later
            return
        plan = self._agents.plan(name, advice.cycle)
        if plan is None:
            return
        if advice.depart_ns is None:
            stop, known = plan.stops[advice.leg], None if van.serves is None else van.serves[0]
            if stop.stop != known and stop in plan.service_stops:
                self._serve(van, stop, now_s)  # a further one at the same junction
        elif advice.depart_ns > now_ns:
            van.look_ns = min(van.look_ns, advice.depart_ns)
        else:
            self._enter(name, van, plan, advice.leg, now_s)

    def _serve(self, van: SimulatedVan, stop: PlannedStop, now_s: float) -> None:
        if stop.stop in self.begun_s:
            self.again.append(stop.stop)
        self.begun_s.setdefault(stop.stop, now_s)
        service_s = self._service_s(stop.stop)
        if service_s is None:
            stays_s = 1e-9 * (stop.departure_ns - stop.arrival_ns)
            service_s = max(0.0, stays_s - stop.wait_s)
        van.serves, van.told_s = (stop.stop, now_s + service_s), 0.0

    def _enter(
        self, name: str, van: SimulatedVan, plan: VehiclePlan, leg: int, now_s: float
    ) -> None:
        planned = planned_leg(plan, leg)
        # Not at leg 0: the first stop may be at the depot's junction.
        begins = plan.continues is None and van.begun != plan.cycle
        if begins:
            van.tour, van.leg, van.begun = van.tour + 1, 0, plan.cycle
            van.ready_s = min(now_s, max(van.ready_s, self._time_s(plan.issued_ns)))
        due_s = self._time_s(plan.depart_ns) if begins else van.ready_s
        if not begins and plan.stops[leg].wait_s > 0:
            due_s = max(due_s, self._time_s(plan.stops[leg].departure_ns))
        due_s = max(due_s, van.ready_s + _breaks_s(plan, leg))
        path = tuple(segment.segment for segment in planned)
        van.way = DrivenWay(plan, leg, planned, path, due_s, free_s(planned, self._top_mps))
        van.serves, van.entering = None, True
        sumo = f"{PREFIX}{name}/{van.tour}/{van.leg}"
        van.driver = Driver(sumo, self._pace, self._step_s, van.real)

        def add() -> None:
            libsumo.route.add(sumo, list(path))
            libsumo.vehicle.add(
                sumo,
                sumo,
                typeID="cav",
                depart="now",
                departLane="best",
                departPos="base",
                departSpeed="0",
                arrivalSpeed="0",
            )

        self._session.run(add)
        van.driver.begin()

    def _admit(self, now_s: float) -> None:
        """Vehicles that SUMO has found a gap for."""
        waiting = {van.driver.name: van for van in self._vans.values() if van.entering}
        for sumo in libsumo.simulation.getDepartedIDList() if waiting else ():
            van = waiting.get(sumo)
            if van is not None:
                van.entering, van.measured = False, LegMeasurement(now_s)

    def _drive(self, now_ns: int) -> None:
        """Each vehicle on the road senses and obeys, those behind after those ahead of them."""
        self._sensed = {
            name: sense(
                van.driver.name,
                van.way.path[van.way.at],
                now_ns,
                float(libsumo.vehicle.getAcceleration(van.driver.name)),
            )
            for name, van in self._vans.items()
            if van.way is not None and van.measured is not None and _is_placed(van.driver.name)
        }
        followed, self._following = self._following, {}
        parted: dict[str, str | None] = {}
        for name in _front_to_back(self._sensed):
            van = self._vans[name]
            assert van.way is not None
            sensed, real = self._sensed[name], van.real
            if real is not None:
                sensed = real.sensed(sensed, acceleration_ahead(sensed))
            advice = self._agents.advise(sensed)
            self._navigate(name, van, van.way, advice)
            if advice is not None:
                self._advice[name] = advice
            held = van.driver.held
            van.driver.obey(advice, self._sensed[name])
            self.safety.advised(advice, self._sensed[name], held=van.driver.held > held)
            if van.driver.close and advice is not None:
                self._following[name] = advice.mode == "follow"
                if advice.mode == "follow":
                    self._note_silence(advice.partner, now_ns)
                ahead = self._sensed[name].ahead
                close = ahead is not None and ahead.gap_m <= CLOSE_GAP_M
                left = followed.get(name, False) and advice.mode == "open_gap"
                if left and close and "turbulent" in (advice.reason or ""):
                    parted[name] = advice.partner
        # One a platoon: whoever is behind another one that parts is of the same.
        self.disengagements += sum(partner not in parted for partner in parted.values())

    def _why_missed(self, name: str, way: DrivenWay) -> Cause | None:
        """Why it was in no platoon in the step that has ended, if its plan has one there."""
        sensed = self._sensed.get(name)
        if sensed is None:
            return None
        is_open = self._gates.is_open(sensed.segment)
        planned, advice = way.planned[way.at], self._advice.get(name)
        return why_missed(planned, sensed, advice, self._top_mps, is_open=is_open)

    def _note_silence(self, partner: str | None, now_ns: int) -> None:
        advice = self._advice.get(partner or "")
        heard_ns = now_ns if advice is None else advice.time_ns
        self.longest_silence_s = max(self.longest_silence_s, (now_ns - heard_ns) / 1e9)

    def _navigate(
        self, name: str, van: SimulatedVan, way: DrivenWay, advice: VehicleAdvice | None
    ) -> None:
        """Take another way to the next stop, as a newer plan has it."""
        if advice is None or advice.cycle is None or advice.cycle == way.plan.cycle:
            return
        plan = self._agents.plan(name, advice.cycle)
        if plan is None or advice.leg is None:
            return
        planned = planned_leg(plan, advice.leg)
        path = tuple(segment.segment for segment in planned)
        present = way.path[way.at]
        if present not in path:
            return
        at = path.index(present)
        if path[at:] != way.path[way.at :]:
            sumo = van.driver.name
            if libsumo.vehicle.getRoadID(sumo).startswith(":"):
                return  # in a junction, SUMO takes no other route: at the next step
            self._session.run(lambda: libsumo.vehicle.setRoute(sumo, list(path[at:])))
            # SUMO may keep the driven segments; both paths end at the same place.
            way.behind = len(path) - len(libsumo.vehicle.getRoute(sumo))
        else:
            way.behind += at - way.at
        way.driven += way.path[way.first : way.at]
        way.plan, way.number, way.planned = plan, advice.leg, planned
        way.path, way.at, way.first = path, at, at

    def _has_arrived(self, sumo: str, way: DrivenWay, speed_mps: float) -> bool:
        if way.at < len(way.path) - 1 or speed_mps > _ARRIVED_MPS:
            return False
        if libsumo.vehicle.getRoadID(sumo).startswith(":"):
            return False
        left_m = self._lengths_m[way.path[-1]] - libsumo.vehicle.getLanePosition(sumo)
        return bool(left_m < _ARRIVED_M)

    def _end(self, name: str, van: SimulatedVan, now_s: float) -> DrivenLeg:
        assert van.way is not None
        assert van.measured is not None
        way = van.way
        driven = van.measured.finish(
            name,
            van.tour,
            van.leg,
            (van.ready_s, way.due_s, now_s),
            way.free_s,
            way.driven + way.path[way.first :],
            self._step_s,
            self._physics,
        )
        van.way, van.measured = None, None
        van.segment, van.leg, van.ready_s = way.path[-1], van.leg + 1, now_s
        van.look_ns, van.since_ns = 0, self._clock_ns()
        reached = way.number + 1
        if reached == len(way.plan.stops) - 1:
            self.tours_finished += 1
        elif not way.plan.stops[reached].is_hub:
            self._serve(van, way.plan.stops[reached], now_s)
        return driven

    def _time_s(self, time_ns: int) -> float:
        """The simulation's time of a moment, s."""
        return self._session.time_s + (time_ns - self._clock_ns()) / 1e9


def _breaks_s(plan: VehiclePlan, leg: int) -> float:
    """Length of the breaks that are taken since the last stop before a leg, s."""
    breaks = takewhile(lambda stop: stop.kind == "break", reversed(plan.stops[: leg + 1]))
    return sum(stop.break_s for stop in breaks)


def _is_placed(sumo: str) -> bool:
    """Whether a vehicle is on a road; SUMO takes one off for a while that it teleports."""
    return bool(libsumo.vehicle.getRoadID(sumo))


def _front_to_back(sensed: Mapping[str, VehicleSensing]) -> Iterator[str]:
    """Vehicles, each after the one of the fleet that it is directly behind."""
    done: set[str] = set()
    for name in sensed:
        queue = [name]
        while (ahead := sensed[queue[-1]].ahead) is not None:
            if ahead.vehicle not in sensed or ahead.vehicle in done or ahead.vehicle in queue:
                break
            assert ahead.vehicle is not None
            queue.append(ahead.vehicle)
        for one in reversed(queue):
            if one not in done:
                done.add(one)
                yield one
