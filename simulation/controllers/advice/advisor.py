"""Speed advice for the fleet's vehicles: the largest speed for each coming step."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

from simulation.controllers.advice.approach import (
    Margins,
    Window,
    arrival_speed_mps,
    choose_arrival_s,
)
from simulation.controllers.advice.coasting import CoastingModel, braked_mps
from simulation.controllers.advice.radar import (
    LeadVehicle,
    Radar,
    is_closing,
    lead_vehicle,
    queue_length,
)
from simulation.controllers.advice.road import LegRoad, Roads, StopLine, leg_road, read_roads
from simulation.controllers.advice.value_of_time import leg_value_of_time_w
from simulation.controllers.vehicle import LegOrder, VehicleState, free_drive_s
from slipstream.energy import PAPER_CAR, VehicleParameters

_HORIZON_M: Final = 600.0
"""Rolling from city speeds to a stop takes less, and signals further off change before."""


class SignalTiming(Protocol):
    """What RSUs broadcast of their signals."""

    def upcoming(self, tls: str, link: int, now_s: float) -> tuple[Window, ...]:
        """The greens of a movement that are known, soonest first."""
        ...


@dataclass(frozen=True)
class AdviceParameters:
    """How vehicles of the fleet drive.

    Attributes:
        braking_mps2: comfortable deceleration before turns and stops.
        hard_mps2: deceleration up to which a vehicle stops for a yellow light; SUMO's `decel`.
        slowing_mps2: deceleration towards the speed for a signal that is far off.
        acceleration_mps2: in predictions.
        margins: at signals.
    """

    braking_mps2: float = 1.5
    hard_mps2: float = 2.5
    closing_mps2: float = 0.3
    slowing_mps2: float = 1.5
    acceleration_mps2: float = 1.3
    margins: Margins = field(default_factory=Margins)


@dataclass
class _Leg:
    order: LegOrder
    road: LegRoad
    value_of_time_w: float
    budget_s: float
    spent_s: float
    leader: str = ""
    leader_mps: float = 0.0


class SpeedAdvisor:
    """Speeds for vehicles whose plan has eco-approach, coasting, or both.

    Args:
        net: the SUMO net, or what was read of it.
        signals: the timing that is broadcast.
        step_s: of the simulation.
        vehicle: physical data.
        parameters: how the vehicles drive.
    """

    def __init__(
        self,
        net: Path | Roads,
        signals: SignalTiming,
        step_s: float,
        vehicle: VehicleParameters = PAPER_CAR,
        parameters: AdviceParameters | None = None,
        radar: Radar = lead_vehicle,
    ) -> None:
        self._roads = net if isinstance(net, Roads) else read_roads(net)
        self._signals = signals
        self._step_s = step_s
        self._vehicle = vehicle
        self._coasting = CoastingModel.of(vehicle)
        self._parameters = parameters or AdviceParameters()
        self._radar = radar
        self._legs: dict[str, _Leg] = {}

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle entered the road, or was rerouted on it; its spent coasting time is kept."""
        if not (order.advice.eco_approach or order.advice.coasting_budget > 0):
            return
        road = leg_road(self._roads, order.path)
        budget_s = order.advice.coasting_budget * order.free_s
        value_of_time_w = leg_value_of_time_w(
            road, budget_s, self._coasting, self._parameters.braking_mps2, self._vehicle
        )
        known = self._legs.get(name)
        spent_s = 0.0 if known is None else known.spent_s
        self._legs[name] = _Leg(order, road, value_of_time_w, budget_s, spent_s)

    def ended(self, name: str) -> None:
        """A vehicle left the road."""
        self._legs.pop(name, None)

    def cap_mps(
        self, name: str, now_s: float, state: VehicleState, tail_m: float = 0.0
    ) -> float | None:
        """Largest speed after the coming step, m/s; None: no advice.

        Args:
            name: of the vehicle.
            now_s: simulated time.
            state: of the vehicle now.
            tail_m: from its front to the end of the last vehicle that goes with it.
        """
        leg = self._legs.get(name)
        if leg is None:
            return None
        place_m = leg.road.place_m(state)
        if not state.crossing and self._is_committed(leg, now_s, state, place_m):
            return None
        lead = self._radar(name)
        cap = math.inf
        if leg.order.advice.eco_approach and not state.crossing:
            cap = self._for_signal(leg, now_s, state, place_m, tail_m, lead)
        if leg.spent_s < leg.budget_s and state.speed_mps > 0:
            cap = min(cap, self._coast_speed(leg, state, place_m))
        if lead is not None:
            steady = lead.name == leg.leader and lead.speed_mps <= leg.leader_mps + 0.05
            leg.leader, leg.leader_mps = lead.name, lead.speed_mps
            if steady and is_closing(lead, state.speed_mps, self._parameters.closing_mps2):
                cap = min(cap, self._coasting.after(state.speed_mps, self._step_s))
        return None if cap == math.inf else cap

    def _is_committed(self, leg: _Leg, now_s: float, state: VehicleState, place_m: float) -> bool:
        """Whether the light ahead is no longer green and the vehicle too near to stop for it.

        SUMO lets such a vehicle go on while it is yellow; advice to slow down would bring it to
        the line when it is red.
        """
        line = self._line(leg, state, place_m)
        if line is None:
            return False
        speed = state.speed_mps
        stopping_m = speed**2 / (2 * self._parameters.hard_mps2) + speed * self._step_s
        if line.at_m - place_m > stopping_m:
            return False
        windows = self._signals.upcoming(line.tls, line.link, now_s)
        return not windows or windows[0].begin_s > now_s

    def _coast_speed(self, leg: _Leg, state: VehicleState, place_m: float) -> float:
        """The speed of rolling, if it is time to roll towards a place where speed must be lower."""
        speed, braking = state.speed_mps, self._parameters.braking_mps2
        limit = leg.road.limits_mps[state.number]
        for slow in leg.road.slow_ahead(place_m):
            ahead_m = slow.at_m - place_m
            if ahead_m > _HORIZON_M:
                break
            if ahead_m <= self._coasting.approach_m(
                speed, slow.speed_mps, leg.value_of_time_w, braking
            ):
                unhindered = min(limit, braked_mps(ahead_m, slow.speed_mps, braking))
                if unhindered > speed:
                    leg.spent_s += self._step_s * (1 - speed / unhindered)
                return max(slow.speed_mps, self._coasting.after(speed, self._step_s))
        return math.inf

    def _for_signal(
        self,
        leg: _Leg,
        now_s: float,
        state: VehicleState,
        place_m: float,
        tail_m: float,
        lead: LeadVehicle | None,
    ) -> float:
        """The speed that reaches the next stop line at green."""
        line = self._line(leg, state, place_m)
        if line is None:
            return math.inf
        speed, margins = state.speed_mps, self._parameters.margins
        limit = leg.road.limits_mps[state.number]
        ahead_m = line.at_m - place_m
        windows = self._signals.upcoming(line.tls, line.link, now_s)
        earliest_s = now_s + free_drive_s(ahead_m, speed, limit, self._parameters.acceleration_mps2)
        tail_s = tail_m / line.passing_mps
        arrive_s = choose_arrival_s(
            windows, now_s, earliest_s, tail_s, queue_length(lead, ahead_m), margins
        )
        if arrive_s is None or arrive_s <= earliest_s:
            return math.inf
        step_s = self._step_s
        wanted = arrival_speed_mps(
            self._coasting,
            ahead_m - speed * step_s,
            arrive_s - now_s - step_s,
            margins.min_mps,
        )
        if wanted is None:
            return max(margins.min_mps, self._coasting.after(speed, step_s))
        return max(wanted, speed - self._parameters.slowing_mps2 * step_s)

    def _line(self, leg: _Leg, state: VehicleState, place_m: float) -> StopLine | None:
        """The next stop line, if it is near."""
        for line in leg.road.lines:
            if line.at_m > place_m:
                return line if line.at_m - place_m <= _HORIZON_M else None
        return None
