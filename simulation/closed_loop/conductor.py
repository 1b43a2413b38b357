"""Who tells the fleet's vehicles how to drive in the coming step: platooning, advice, priority."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from simulation.closed_loop.vehicle import LegOrder, VehicleState


@dataclass(frozen=True)
class Drafting:
    """What of the coming step is driven in platoons.

    Attributes:
        eta: drag reduction by vehicle; those alone are left out.
        turbulent: vehicles close behind or before another one, parting included, where the traffic
            is turbulent in truth.
    """

    eta: Mapping[str, float] = field(default_factory=dict)
    turbulent: frozenset[str] = frozenset()


class Conductor(Protocol):
    """Sets speeds, types and signals of the running simulation."""

    @property
    def disengagements(self) -> int:
        """Platoons that had to part so far."""
        ...

    def departed(self, name: str, order: LegOrder) -> None:
        """A vehicle came onto the road, or was given another way on it."""
        ...

    def ended(self, name: str) -> None:
        """A vehicle is off the road."""
        ...

    def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
        """Before each step; the states are those after the last one."""
        ...


class NoConductor:
    """Vehicles drive as SUMO's drivers do."""

    disengagements = 0

    def departed(self, name: str, order: LegOrder) -> None:
        """Nothing to prepare."""

    def ended(self, name: str) -> None:
        """Nothing to forget."""

    def control(self, now_s: float, states: Mapping[str, VehicleState]) -> Drafting:
        """Nobody is told anything."""
        return Drafting()
