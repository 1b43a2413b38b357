"""Stretches of a segment's order of entry, and how one passage more or less changes one.

Answers about a platoon are None where other passages may not stay in their places.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field

from dispatcher_daemon.planning.platooning.platoons import TimedPassage, independent_groups

Traversal = TimedPassage[tuple[int, ...]]
"""A passage by a vehicle's number in the fleet, with its approach if `ExpectedDrafting` counts."""


@dataclass(slots=True)
class Stretch:
    """Passages that no earlier one reaches into, as platoons; it is not changed.

    Attributes:
        platoons: in the order of their leaders, at least one.
        vehicles: that pass; None: one of them passes twice, which has rules of its own.
    """

    platoons: Sequence[Sequence[Traversal]]
    saved_kwh: Sequence[float]
    vehicles: frozenset[int] | None
    total_kwh: float = field(init=False)

    def __post_init__(self) -> None:
        self.total_kwh = sum(self.saved_kwh)

    def ends_before(self, passage: Traversal, window_s: float) -> bool:
        """Whether a later passage is out of reach of all its platoons."""
        return passage[0] - self.platoons[-1][0][0] > window_s

    def platoon_with(
        self, passage: Traversal, window_s: float
    ) -> tuple[int, list[Traversal]] | None:
        """(number of the platoon that a passage joins, that platoon with it)."""
        if self.vehicles is None or passage[2][0] in self.vehicles:
            return None
        entry, leaving, _ = passage
        for number, platoon in enumerate(self.platoons):
            lead = platoon[0]
            if passage < lead:
                return None
            if entry - lead[0] > window_s:
                continue
            at = bisect_left(platoon, passage)
            if platoon[at - 1][1] <= leaving <= lead[1] + window_s:
                if at < len(platoon) and platoon[at][1] < leaving:
                    return None
                return number, [*platoon[:at], passage, *platoon[at:]]
        return None

    def platoon_led_by(self, passage: Traversal, window_s: float) -> list[Traversal] | None:
        """The first platoon with an earlier passage in front, likewise."""
        if self.vehicles is None or passage[2][0] in self.vehicles:
            return None
        entry, leaving, _ = passage
        platoon, *others = self.platoons
        lead, last = platoon[0], platoon[-1]
        if not leaving <= lead[1] or last[1] > leaving + window_s:
            return None
        if last[0] - entry > window_s or (others and others[0][0][0] - entry > window_s):
            return None
        return [passage, *platoon]

    def platoon_without(self, passage: Traversal) -> tuple[int, list[Traversal]] | None:
        """(number of the platoon that a passage leaves, that platoon without it), likewise."""
        if self.vehicles is None:
            return None
        for number, platoon in enumerate(self.platoons):
            at = bisect_left(platoon, passage)
            if at == len(platoon) or platoon[at] != passage:
                continue
            if at == 0:
                # The next one's window is another one.
                alone = len(self.platoons) == 1 and len(platoon) > 1
                return (number, [*platoon[1:]]) if alone else None
            # Whom only it kept from joining may join.
            before, leaving = platoon[at - 1][1], passage[1]
            for later in self.platoons[number + 1 :]:
                if any(before <= other[1] < leaving for other in later):
                    return None
            return number, [*platoon[:at], *platoon[at + 1 :]]
        return None

    def total_kwh_with(self, number: int, saved_kwh: float) -> float:
        """What all platoons save if one of them saves so much."""
        every_kwh = list(self.saved_kwh)
        every_kwh[number] = saved_kwh
        return sum(every_kwh)

    def replaced(
        self, number: int, platoon: Sequence[Traversal], saved_kwh: float, passage: Traversal
    ) -> Stretch:
        """The stretch with another platoon in the place of one, which a passage joined or left."""
        platoons, every_kwh = list(self.platoons), list(self.saved_kwh)
        platoons[number], every_kwh[number] = platoon, saved_kwh
        vehicles = None if self.vehicles is None else self.vehicles ^ {passage[2][0]}
        return Stretch(platoons, every_kwh, vehicles)


def stretch_at(
    passages: Sequence[Traversal], at: int, window_s: float
) -> tuple[int, list[list[Traversal]], frozenset[int] | None]:
    """(position of the next passage, platoons, vehicles) of the stretch from a passage on."""
    end, platoons = independent_groups(passages, at, window_s)
    vehicles = frozenset([passage[2][0] for passage in passages[at:end]])
    return end, platoons, vehicles if len(vehicles) == end - at else None
