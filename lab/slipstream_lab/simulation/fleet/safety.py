"""What goes wrong on the simulated roads, the fleet's apart from others', and what nearly does."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Final, Self

from slipstream.messages import VehicleAdvice, VehicleSensing
from slipstream_lab.simulation.sumo import FLEET_PREFIX

log = logging.getLogger(__name__)

MAX_TELEPORTED: Final = 0.01
"""Of the background's trips. SUMO teleports who has stood for 300 s: at 1 % these standstills alone
come to 3 s a trip, twice what the arms of Troy change the trips of others by (1.1 to 1.5 s)."""

_MISSED_MPS2: Final = 0.2
"""Beyond it a promise counts as broken: brakes miss what is commanded by some per cent."""


@dataclass(frozen=True)
class Incidents:
    """What SUMO names: collisions, vehicles that could not brake in time, and vehicles that it took
    off a road on which they had stood for too long.
    """

    collisions: int = 0
    emergency_stops: int = 0
    teleports: int = 0

    @property
    def words(self) -> str:
        """What there was, for people; "": nothing."""
        counts = (
            (self.collisions, "collision"),
            (self.emergency_stops, "emergency stop"),
            (self.teleports, "teleport"),
        )
        return ", ".join(f"{n} {what}{'s' if n > 1 else ''}" for n, what in counts if n)

    def more(self, collisions: int, emergency_stops: int, teleports: int) -> Self:
        """With so many more."""
        return replace(
            self,
            collisions=self.collisions + collisions,
            emergency_stops=self.emergency_stops + emergency_stops,
            teleports=self.teleports + teleports,
        )


@dataclass(frozen=True)
class OthersSafety(Incidents):
    """Of the background. `trips`: that came onto the road."""

    trips: int = 0

    @property
    def is_doubtful(self) -> bool:
        """Whether so many were teleported that the traffic says little."""
        return self.teleports > MAX_TELEPORTED * self.trips


@dataclass(frozen=True)
class FleetSafety(Incidents):
    """Of a simulated fleet. A collision is the fleet's if a vehicle of it is in it.

    Attributes:
        promises_broken: times that a vehicle began to brake harder than others reckoned with.
        most_over_mps2: by how much at most.
        held_back: steps in which SUMO's own check braked a vehicle of a platoon harder than its
            agent.
        least_gap_m: between a follower and whom it followed; None: nobody followed.
    """

    promises_broken: int = 0
    most_over_mps2: float = 0.0
    held_back: int = 0
    least_gap_m: float | None = None


NOTHING: Final = FleetSafety()
NO_OTHERS: Final = OthersSafety()


class SafetyWatch:
    """Counts, step by step.

    Attributes:
        found: so far.
        others: of vehicles that are not the fleet's, likewise.
    """

    def __init__(self, step_s: float) -> None:
        self.found, self.others = NOTHING, NO_OTHERS
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
        departed: Iterable[str] = (),
    ) -> None:
        """What SUMO names after the step: pairs that collide, vehicles that could not brake in
        time, vehicles that it takes off the road for a while, and those that came onto it.
        """
        pairs, stops = {frozenset(pair) for pair in colliding}, set(stopping)
        new, begun, moved = pairs - self._colliding, stops - self._stopping, tuple(teleporting)
        self._colliding, self._stopping = pairs, stops
        trips = sum(not _is_own(sumo) for sumo in departed)
        if not (new or begun or moved or trips):
            return
        hit = [pair for pair in new if any(map(_is_own, pair))]
        stopped, taken = list(filter(_is_own, begun)), list(filter(_is_own, moved))
        if hit or stopped or taken:
            log.debug("collisions %s, emergency stops %s, teleports %s", hit, stopped, taken)
        self.found = self.found.more(len(hit), len(stopped), len(taken))
        others = self.others.more(
            len(new) - len(hit), len(begun) - len(stopped), len(moved) - len(taken)
        )
        self.others = replace(others, trips=others.trips + trips)


def _is_own(sumo: str) -> bool:
    return sumo.startswith(FLEET_PREFIX)
