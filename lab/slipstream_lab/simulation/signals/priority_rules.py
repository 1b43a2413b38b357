"""Transit signal priority's rules, as pure decisions: green extension and early green.

- Green extension: the movement is green, and would turn yellow before the vehicle is through: the
  phase is extended until then, by `max_extension_s` at most.
- Early green: it is red: phases in between end earlier than usual, each after its least time and no
  earlier than it takes to have the green, and the queue before it gone, as the vehicle comes.
- No phase is left out, each yellow and each clearance lasts its time, the order stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from slipstream_lab.simulation.signals.program import Program


@dataclass(frozen=True)
class PrioritySettings:
    """How priority is given.

    Attributes:
        lead_s: how long before a vehicle's arrival the green should begin, so that it need not
            brake.
        max_losing: vehicles before the signal on the lanes that would lose their green, at which
            it is still cut.
        pause_cycles: usual cycles from the end of a grant until the signal gives the next one.
    """

    lead_s: float = 6.0
    queue_s: float = 2.0
    max_extension_s: float = 15.0
    max_losing: float = 1000
    pause_cycles: float = 1.0

    def __post_init__(self) -> None:
        if any(value < 0 for value in vars(self).values()):
            raise ValueError("times of signal priority must be >= 0")


class ExtendPhase(NamedTuple):
    """Let the running phase end at another time than it would."""

    until_s: float


class EndPhase(NamedTuple):
    """End the running phase at this time, or now if it is past."""

    at_s: float


def decide(
    program: Program,
    phase: int,
    begun_s: float,
    end_s: float,
    link: int,
    wanted_s: float,
    through_s: float,
    latest_s: float,
) -> ExtendPhase | EndPhase | None:
    """What to do with the running phase for a vehicle; None: nothing helps or nothing is needed.
    `end_s`: when it would end without priority; at the earliest, if it is actuated.
    """
    running = program.phases[phase]
    if running.clearing or len(running.next) != 1:
        return None
    if running.allows(link):
        closes_s = _closes_s(program, phase, end_s, link)
        if closes_s is None or closes_s >= through_s:
            return None
        until_s = end_s + through_s - closes_s
        return ExtendPhase(until_s) if until_s <= latest_s else None
    min_end_s = begun_s + running.min_s
    between_s, nominal_s = _between_s(program, phase, link)
    if between_s is None:
        return None
    if program.fixed and end_s + nominal_s <= wanted_s:
        return None
    at_s = max(min_end_s, wanted_s - between_s)
    if program.fixed and at_s >= end_s:
        return None
    return EndPhase(at_s)


def _closes_s(program: Program, phase: int, end_s: float, link: int) -> float | None:
    """When a movement that may go now must stop, if the running phase ends as given."""
    for _ in program.phases:
        following = program.phases[phase].next
        if len(following) != 1:
            return end_s
        phase = following[0]
        if not program.phases[phase].allows(link):
            return end_s
        end_s += program.phases[phase].min_s
    return None


def _between_s(program: Program, phase: int, link: int) -> tuple[float | None, float]:
    """Time between a phase and the next one in which a movement may go: the least, the usual."""
    min_s = nominal_s = 0.0
    for _ in program.phases:
        following = program.phases[phase].next
        if len(following) != 1:
            break
        phase = following[0]
        if program.phases[phase].allows(link):
            return min_s, nominal_s
        min_s += program.phases[phase].min_s
        nominal_s += program.phases[phase].nominal_s
    return None, 0.0
