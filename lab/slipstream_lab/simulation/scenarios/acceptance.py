"""Acceptance of a scenario's day for an evaluation, with the reasons of a refusal."""

from __future__ import annotations

from dataclasses import dataclass

from slipstream.errors import InputError
from slipstream_lab.simulation.scenarios.record import SimulatedDay


@dataclass(frozen=True)
class AcceptanceLimits:
    """Limits of a day.

    Attributes:
        left: vehicles driving or waiting at the end, below; of whole days alone.
        incidents: share of the trips, at most, for each of teleports, collisions and emergency
            stops; one of these is a vehicle that could not brake in time.
    """

    incidents: float = 0.0
    depart_delay_s: float = 5.0
    left: int = 100

    def faults(self, day: SimulatedDay) -> tuple[str, ...]:
        """Reasons to refuse a day; empty if it is accepted."""
        found, faults = day.statistics, []
        if day.gridlock_s is not None:
            faults.append(f"gridlock at {clock(day.gridlock_s)}")
        most = int(self.incidents * found.inserted)
        if found.teleports > most:
            faults.append(f"{found.teleports} teleports (at most {most})")
        if found.mean_depart_delay_s >= self.depart_delay_s:
            faults.append(
                f"departures {found.mean_depart_delay_s:.1f} s late on average "
                f"(below {self.depart_delay_s:g} s)"
            )
        left = found.running + found.waiting
        if day.end_s % 86400 == 0 and left >= self.left:
            faults.append(f"{left} vehicles left at the end (below {self.left})")
        if found.collisions > most:
            faults.append(f"{found.collisions} collisions (at most {most})")
        if found.emergency_stops > most:
            faults.append(f"{found.emergency_stops} emergency stops (at most {most})")
        return tuple(faults)

    def check(self, day: SimulatedDay, scenario: str) -> None:
        """Refuse a day that is not fit. Raises InputError: naming every fault."""
        faults = self.faults(day)
        if faults:
            raise InputError(scenario, "; ".join(faults), "take fewer trips or another network")


def clock(time_s: float) -> str:
    """A time of the day as HH:MM."""
    minutes = int(time_s // 60)
    return f"{minutes // 60 % 24:02}:{minutes % 60:02}"
