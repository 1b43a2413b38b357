"""A signal program: its phases, and how they follow one another from any moment in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Final

from slipstream.messages import PhaseState

FREE: Final = "GO"
"""Letters of SUMO's states that let a movement go before all others."""

YIELDING: Final = "go"
"""Letters that let it go through the gaps of traffic that has priority."""

_SHOWN: Final[Mapping[str, PhaseState]] = {
    "G": "protected-Movement-Allowed",
    "g": "permissive-Movement-Allowed",
    "u": "pre-Movement",
    "o": "dark",
    "O": "dark",
}
"""By SUMO's letters but yellow; all others stop."""

MAX_COMPENSATION_S: Final = 15.0
"""What a phase that was cut gets back in one turn at most."""

NO_COMPENSATION: Final[Mapping[int, float]] = MappingProxyType({})

_CYCLES: Final = 2


@dataclass(frozen=True)
class Phase:
    """A phase of a program.

    Attributes:
        nominal_s: what it lasts in a program of fixed times; in an actuated one its nominal time.
        min_s: what it lasts at least; in a program of fixed times, when it is shortened.
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
    """The phases of a signal."""

    phases: tuple[Phase, ...]
    fixed: bool

    @cached_property
    def cycle_s(self) -> float:
        """The usual time of a cycle."""
        return sum(phase.nominal_s for phase in self.phases)

    @cached_property
    def shown(self) -> tuple[tuple[PhaseState, ...], ...]:
        """What each movement shows in each phase: yellow is that of the green before it."""
        return tuple(
            _shown(letters) for letters in zip(*(phase.state for phase in self.phases), strict=True)
        )

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
    ) -> Iterator[tuple[int, float]]:
        """Phases from the running one on and when each ends, as far as the program fixes them.

        Fixed times: two cycles beyond the running phase. Actuated: the earliest ends, for one turn,
        or until it is open what follows.

        Args:
            end_s: its end; the earliest one if it is actuated.
            compensation_s: by phase, to be taken from its next turn: positive after an extension,
                negative after an early end. Programs of fixed times only.
        """
        owed = dict(compensation_s)
        until_s = end_s + _CYCLES * self.cycle_s
        turn = 0
        while True:
            yield phase, end_s
            turn += 1
            if len(self.phases[phase].next) != 1:
                return
            if end_s >= until_s if self.fixed else turn == len(self.phases):
                return
            phase = self.phases[phase].next[0]
            following = self.phases[phase]
            lasting_s = following.min_s
            if self.fixed:
                lasting_s = self.settled_s(phase, owed.get(phase, 0.0))
                owed[phase] = owed.get(phase, 0.0) + lasting_s - following.nominal_s
            end_s += lasting_s


def _shown(letters: Sequence[str]) -> tuple[PhaseState, ...]:
    """The states of one movement by its letters in all phases."""
    states: list[PhaseState] = []
    for number, letter in enumerate(letters):
        if letter in "yY":
            before = [*reversed(letters[:number]), *reversed(letters[number:])]
            green = next((known for known in before if known in "gG"), "g")
            states.append("protected-clearance" if green == "G" else "permissive-clearance")
        else:
            states.append(_SHOWN.get(letter, "stop-And-Remain"))
    return tuple(states)
