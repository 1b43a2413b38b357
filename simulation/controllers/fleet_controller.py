"""The controller of the fleet: platooning, speed advice and signal priority combined."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import libsumo

from simulation.controllers.advice import SpeedAdvisor
from simulation.controllers.platooning import Platooning
from simulation.controllers.signals import Priority, Signals
from simulation.controllers.vehicle import LegOrder, VehicleState


@dataclass(frozen=True)
class Drafting:
    """Platooning in the coming step.

    Attributes:
        eta: drag reduction by vehicle; vehicles without one are left out.
        turbulent: vehicles in a close gap, leaving ones included, on segments whose true traffic is
            turbulent.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()


class VehicleController(Protocol):
    """Sets speeds, types and signals of the running simulation."""

    @property
    def disengagements(self) -> int:
        """Number of disengagements so far."""
        ...

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle entered the road, or was rerouted on it."""
        ...

    def ended(self, name: str) -> None:
        """A vehicle left the road."""
        ...

    def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
        """Called before each step with the states after the last step."""
        ...


class Gates(Protocol):
    """Gate and traffic state of a segment."""

    def is_open(self, segment: str) -> bool:
        """Whether close gaps are allowed on it."""
        ...

    def is_turbulent(self, segment: str) -> bool:
        """Whether platoons must disengage on it."""
        ...


class FleetController:
    """Sets the speeds of a running simulation's fleet, and asks its signals for green.

    Args:
        levers: `platoons` and `priority` enable these controllers. Which speed advice a vehicle
            follows is in its plan.
        net: the SUMO net.
        step_s: of the simulation.
        lengths_m: of its segments.
        roadside: gates, and where the true traffic is turbulent.
    """

    def __init__(
        self,
        levers: Container[str],
        net: Path,
        step_s: float,
        lengths_m: Mapping[str, float],
        roadside: Gates,
    ) -> None:
        signals = Signals()
        self._advisor = SpeedAdvisor(net, signals, step_s)
        self._priority = Priority(signals, "priority" in levers)
        self._platooning = Platooning(
            roadside.is_open,
            roadside.is_turbulent,
            step_s,
            lengths_m,
            enabled="platoons" in levers,
        )
        self._held: set[str] = set()
        self.signals = signals

    @property
    def disengagements(self) -> int:
        """Number of disengagements so far."""
        return self._platooning.disengagements

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle entered the road, or was rerouted on it."""
        self._platooning.departed(name, order)
        self._advisor.departed(name, order)
        if order.advice.signal_priority:
            self._priority.departed(name, order)

    def ended(self, name: str) -> None:
        """A vehicle left the road."""
        for part in (self._platooning, self._advisor, self._priority):
            part.ended(name)
        self._held.discard(name)

    def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
        """Called before each step with the states after the last step."""
        platoons = self._platooning.step(now_s, states)
        for name, state in states.items():
            cap = platoons.caps.get(name)
            if name not in platoons.follows:
                # A platoon goes through signals as one: its leader takes care of them all.
                advised = self._advisor.cap_mps(name, now_s, state, platoons.tail_m.get(name, 0.0))
                cap = min((c for c in (cap, advised) if c is not None), default=None)
            self._hold(name, cap)
        self._priority.step(now_s, states, platoons.tail_m)
        return Drafting(platoons.eta, platoons.turbulent)

    def _hold(self, name: str, cap: float | None) -> None:
        """Set a vehicle's speed, or release it; SUMO's safety checks stay on."""
        if cap is not None:
            libsumo.vehicle.setSpeed(name, cap)
            self._held.add(name)
        elif name in self._held:
            libsumo.vehicle.setSpeed(name, -1)
            self._held.discard(name)
