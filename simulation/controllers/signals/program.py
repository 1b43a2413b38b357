"""A signal program: its phases, and when a movement will be green from any moment in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

FREE: Final = "GO"
"""Letters of SUMO's states that let a movement go before all others."""

YIELDING: Final = "go"
"""Letters that let it go through the gaps of traffic that has priority."""

MAX_COMPENSATION_S: Final = 15.0
"""What a phase that was cut gets back in one turn at most."""

NO_COMPENSATION: Final[Mapping[int, float]] = MappingProxyType({})

_CYCLES: Final = 2


class Green(NamedTuple):
    """A time in which a movement may go.

    Attributes:
        begin_s: simulated time; past for a green that runs.
        end_s: when yellow begins; infinite where it never does.
        certain: whether both ends are fixed. If not (actuated signal), `end_s` is the earliest end
            and `begin_s` the earliest begin.
        protected: whether the movement has right of way in all of it.
    """

    begin_s: float
    end_s: float
    certain: bool
    protected: bool


@dataclass(frozen=True)
class Phase:
    """A phase of a program.

    Attributes:
        state: a letter for each movement, as SUMO writes them.
        nominal_s: what it lasts in a program of fixed times; in an actuated one its nominal time.
        min_s: what it lasts at least; in a program of fixed times, when it is shortened.
        next: phases that can follow.
    """

    state: str
    nominal_s: float
    min_s: float
    next: tuple[int, ...]

    def allows(self, link: int) -> bool:
        """Whether a movement may go in it."""
        return self.state[link] in FREE or self.state[link] in YIELDING

    @property
    def clearing(self) -> bool:
        """Whether it clears the junction: some movement is yellow, or none may go."""
        return "y" in self.state or not any(c in "GgOo" for c in self.state)


@dataclass(frozen=True)
class Program:
    """The phases of a signal.

    Attributes:
        phases: in order.
        fixed: whether each lasts its usual time, whatever traffic comes.
    """

    phases: tuple[Phase, ...]
    fixed: bool

    @property
    def cycle_s(self) -> float:
        """The usual time of a cycle."""
        return sum(phase.nominal_s for phase in self.phases)

    def settled_s(self, phase: int, compensation_s: float) -> float:
        """How long a phase of fixed time lasts when it gives back, or gets back, what is owed."""
        nominal_s = self.phases[phase].nominal_s
        min_s = self.phases[phase].min_s
        return min(max(nominal_s - compensation_s, min_s), nominal_s + MAX_COMPENSATION_S)

    def course(
        self,
        phase: int,
        end_s: float,
        compensation_s: Mapping[int, float] = NO_COMPENSATION,
        ahead_s: float | None = None,
    ) -> Iterator[tuple[int, float]]:
        """Phases from the running one on and when each ends, as far as the program fixes them.

        Fixed times: as far as asked. Actuated: the earliest ends, until it is open what follows.

        Args:
            phase: that runs.
            end_s: its end; the earliest one if it is actuated.
            compensation_s: see `greens`.
            ahead_s: how far to look beyond that end; two cycles if not given.
        """
        owed = dict(compensation_s)
        until_s = end_s + (_CYCLES * self.cycle_s if ahead_s is None else ahead_s)
        while True:
            yield phase, end_s
            if len(self.phases[phase].next) != 1 or end_s >= until_s:
                return
            phase = self.phases[phase].next[0]
            following = self.phases[phase]
            lasting_s = following.min_s
            if self.fixed:
                lasting_s = self.settled_s(phase, owed.get(phase, 0.0))
                owed[phase] = owed.get(phase, 0.0) + lasting_s - following.nominal_s
            end_s += lasting_s

    def greens(
        self,
        link: int,
        phase: int,
        begun_s: float,
        end_s: float,
        compensation_s: Mapping[int, float] = NO_COMPENSATION,
        ahead_s: float | None = None,
    ) -> tuple[Green, ...]:
        """When a movement may go: all times of two cycles, or the next one of an actuated signal.

        Args:
            link: number of the movement at the signal.
            phase: that runs.
            begun_s: when it began.
            end_s: its end; the earliest one if it is actuated.
            compensation_s: by phase, to be taken from its next turn: positive after an extension,
                negative after an early end. Programs of fixed times only.
            ahead_s: how far to look in programs of fixed times, if not for two cycles.
        """
        if all(p.allows(link) for p in self.phases):
            free = all(p.state[link] in FREE for p in self.phases)
            return (Green(begun_s, math.inf, True, free),)
        found: list[Green] = []
        opened_s: float | None = None
        protected = True
        last_s = begun_s
        for number, ends_s in self.course(phase, end_s, compensation_s, ahead_s):
            running = self.phases[number]
            if running.allows(link):
                if opened_s is None:
                    opened_s, protected = last_s, True
                protected = protected and running.state[link] in FREE
            elif opened_s is not None:
                found.append(Green(opened_s, last_s, self.fixed, protected))
                opened_s = None
                if not self.fixed:
                    break
            last_s = ends_s
        if opened_s is not None and not self.fixed:
            found.append(Green(opened_s, last_s, False, protected))
        return tuple(found)
