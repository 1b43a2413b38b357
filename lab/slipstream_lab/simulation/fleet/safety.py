"""What goes wrong on the simulated roads, the fleet's apart from others', and what nearly does."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final

from slipstream.messages import VehicleAdvice, VehicleSensing
from slipstream_lab.simulation.sumo import FLEET_PREFIX

log = logging.getLogger(__name__)

_MISSED_MPS2: Final = 0.2
"""Beyond it a promise counts as broken: brakes miss what is commanded by some per cent."""


@dataclass(frozen=True)
class FleetSafety:
    """Of a simulated fleet.

    Attributes:
        collisions: with a vehicle of the fleet in it, as SUMO counts them; emergency stops and
            teleports of its vehicles likewise.
        promises_broken: times that a vehicle began to brake harder than others reckoned with.
        most_over_mps2: by how much at most.
        held_back: steps in which SUMO's own check braked a vehicle of a platoon harder than its
            agent.
        least_gap_m: between a follower and whom it followed; None: nobody followed.
    """

    collisions: int = 0
    emergency_stops: int = 0
    teleports: int = 0
    promises_broken: int = 0
    most_over_mps2: float = 0.0
    held_back: int = 0
    least_gap_m: float | None = None


NOTHING: Final = FleetSafety()


class SafetyWatch:
    """Counts, step by step.

    Attributes:
        found: so far.
    """

    def __init__(self, step_s: float) -> None:
        self.found = NOTHING
        self._step_s = step_s
        self._colliding: set[frozenset[str]] = set()
        self._stopping: set[str] = set()
        self._promised: dict[str, tuple[float, VehicleSensing]] = {}
        self._breaking: set[str] = set()

    def advised(self, advice: VehicleAdvice | None, sensed: VehicleSensing, *, held: bool) -> None:
        """What a vehicle is advised for the coming step, and whether it was held back before."""
        found, name = self.found, sensed.vehicle
        least_mps2 = None if advice is None else advice.least_mps2
        if least_mps2 is None:
            self._promised.pop(name, None)
            self._breaking.discard(name)
        else:
            self._promised[name] = least_mps2, sensed
        if held:
            log.debug("%s is held back, advised %s, sensing %s", name, advice, sensed)
            found = replace(found, held_back=found.held_back + 1)
        ahead = sensed.ahead
        follows = advice is not None and advice.mode == "follow" and advice.partner is not None
        if advice is not None and follows and ahead is not None and ahead.vehicle == advice.partner:
            before_m = ahead.gap_m if found.least_gap_m is None else found.least_gap_m
            found = replace(found, least_gap_m=min(before_m, ahead.gap_m))
        self.found = found

    def drove(self, name: str, speed_mps: float) -> None:
        """The speed of a vehicle after the step."""
        promise = self._promised.pop(name, None)
        if promise is None:
            return
        least_mps2, sensed = promise
        mps2 = (speed_mps - sensed.speed_mps) / self._step_s
        if mps2 >= least_mps2 - _MISSED_MPS2:
            self._breaking.discard(name)
            return
        if name not in self._breaking:
            log.debug(
                "%s promised %.2f and braked %.2f, sensing %s", name, least_mps2, mps2, sensed
            )
        self.found = replace(
            self.found,
            promises_broken=self.found.promises_broken + (name not in self._breaking),
            most_over_mps2=max(self.found.most_over_mps2, least_mps2 - mps2),
        )
        self._breaking.add(name)

    def look(
        self,
        colliding: Iterable[tuple[str, str]],
        stopping: Iterable[str],
        teleporting: Iterable[str],
    ) -> None:
        """What SUMO names after the step: pairs that collide, vehicles that could not brake in
        time, vehicles that it takes off the road for a while.
        """
        pairs, stops = {frozenset(pair) for pair in colliding}, set(filter(_is_own, stopping))
        new = [pair for pair in pairs - self._colliding if any(map(_is_own, pair))]
        begun, moved = stops - self._stopping, list(filter(_is_own, teleporting))
        self._colliding, self._stopping = pairs, stops
        if new or begun or moved:
            log.debug("collisions %s, emergency stops %s, teleports %s", new, begun, moved)
            self.found = replace(
                self.found,
                collisions=self.found.collisions + len(new),
                emergency_stops=self.found.emergency_stops + len(begun),
                teleports=self.found.teleports + len(moved),
            )


def _is_own(sumo: str) -> bool:
    return sumo.startswith(FLEET_PREFIX)
