"""Passages of one segment in the order of entry, with what their platoons save, and changes of it.

Forming platoons takes a look at every passage of a stretch. Passages that join platoons, lead them
or leave them mostly leave all the others where they are: that is found by their neighbours. The
others are formed anew.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dispatcher_daemon.planning.platooning.stretches import Stretch, Traversal, stretch_at

_Stretches = tuple[list[Traversal], list[Stretch]]
"""First passages of some stretches, and the stretches."""


@dataclass(slots=True)
class Change:
    """What passages that come and go on one segment change.

    Attributes:
        saving_kwh: by how much more is saved.
        begin: first passage of the part of the segment's order that is formed anew.
        end: first passage behind it; None: it reaches to the last one.
    """

    saving_kwh: float
    begin: Traversal
    end: Traversal | None
    _replaced: slice
    _begins: list[Traversal]
    _stretches: list[Stretch]

    def touches(self, other: Change) -> bool:
        """Whether both form some of the same platoons anew."""
        before = self.end is not None and self.end <= other.begin
        behind = other.end is not None and other.end <= self.begin
        return not before and not behind


class SegmentOrder:
    """The passages of one segment.

    Attributes:
        passages: in the order of entry.
        entries_s: of the passages, likewise.
        numbers: of their vehicles, likewise.
    """

    def __init__(self, window_s: float, kwh: Callable[[Sequence[Traversal]], float]) -> None:
        """Start without passages.

        Args:
            kwh: what a platoon saves.
        """
        self.passages: list[Traversal] = []
        self.entries_s = array("d")
        self.numbers: list[int] = []
        self._window_s, self._kwh = window_s, kwh
        # First passages of the stretches of `independent_groups`, and these.
        self._begins: list[Traversal] = []
        self._stretches: list[Stretch] = []

    def __contains__(self, passage: Traversal) -> bool:
        at = bisect_left(self.passages, passage)
        return at < len(self.passages) and self.passages[at] == passage

    def change(self, off: Sequence[Traversal], on: Sequence[Traversal]) -> Change:
        """What passages of a segment that go, and others that come, at least one of both, would
        change. Platoons are formed anew from the stretch that the first one lies in until a stretch
        behind the last one begins where one has begun before.
        """
        changed = sorted((*off, *on))
        first, last = changed[0], changed[-1]
        begins = self._begins
        replaced = slice(max(0, bisect_right(begins, first) - 1), bisect_right(begins, last))
        begin = min(first, begins[replaced.start]) if begins else first
        found = self._adjusted(replaced, off, on)
        if found is None:
            found = self._formed(replaced, begin, off, on)
        replaced, (new_begins, stretches) = found
        return Change(
            _total_kwh(stretches) - _total_kwh(self._stretches[replaced]),
            begin,
            begins[replaced.stop] if replaced.stop < len(begins) else None,
            replaced,
            new_begins,
            stretches,
        )

    def gain_kwh(self, passage: Traversal) -> float:
        """By how much more is saved with one passage that comes: `change` without the stretches."""
        begins, stretches, window_s = self._begins, self._stretches, self._window_s
        at = bisect_right(begins, passage) - 1
        if at >= 0 and not stretches[at].ends_before(passage, window_s):
            found = stretches[at].platoon_with(passage, window_s)
            if found is None:
                return self.change((), (passage,)).saving_kwh
            number, platoon = found
            total_kwh = stretches[at].total_kwh_with(number, self._kwh(platoon))
            return total_kwh - stretches[at].total_kwh
        if at + 1 == len(begins) or begins[at + 1][0] - passage[0] > window_s:
            return 0.0
        led = stretches[at + 1].platoon_led_by(passage, window_s)
        if led is None:
            return self.change((), (passage,)).saving_kwh
        before_kwh = stretches[at].total_kwh if at >= 0 else 0.0
        total_kwh = before_kwh + stretches[at + 1].total_kwh_with(0, self._kwh(led))
        return total_kwh - (before_kwh + stretches[at + 1].total_kwh)

    def apply(self, off: Sequence[Traversal], on: Sequence[Traversal]) -> float:
        """Make a change; by how much more is saved."""
        change = self.change(off, on)
        for passage in off:
            at = bisect_left(self.passages, passage)
            del self.passages[at], self.entries_s[at], self.numbers[at]
        for passage in on:
            at = bisect_right(self.passages, passage)
            self.passages.insert(at, passage)
            self.entries_s.insert(at, passage[0])
            self.numbers.insert(at, passage[2][0])
        self._begins[change._replaced] = change._begins
        self._stretches[change._replaced] = change._stretches
        return change.saving_kwh

    def copy(self) -> SegmentOrder:
        """The same, for changes that are undone: it does not change with this one."""
        other = SegmentOrder(self._window_s, self._kwh)
        other.passages, other.entries_s = self.passages[:], self.entries_s[:]
        other.numbers = self.numbers[:]
        other._begins, other._stretches = self._begins[:], self._stretches[:]
        return other

    def _formed(
        self, replaced: slice, begin: Traversal, off: Sequence[Traversal], on: Sequence[Traversal]
    ) -> tuple[slice, _Stretches]:
        """(stretches that are replaced, those in their place), formed anew from a passage on."""
        begins, there = self._begins, self.passages
        new_begins: list[Traversal] = []
        stretches: list[Stretch] = []
        first = min((*off, *on))
        if begin < first and self._stretches[replaced.start].ends_before(first, self._window_s):
            new_begins, stretches = [begin], [self._stretches[replaced.start]]
            begin = first
        onward = there[bisect_left(there, begin) :]
        for passage in off:
            onward.remove(passage)
        for passage in on:
            insort(onward, passage)
        at, end = 0, replaced.stop
        while at < len(onward):
            end = bisect_left(begins, onward[at], end)
            if begins[end : end + 1] == [onward[at]]:
                break
            new_begins.append(onward[at])
            at, platoons, vehicles = stretch_at(onward, at, self._window_s)
            saved_kwh = [self._kwh(platoon) for platoon in platoons]
            stretches.append(Stretch(platoons, saved_kwh, vehicles))
        else:
            end = len(begins)
        return slice(replaced.start, end), (new_begins, stretches)

    def _adjusted(
        self, replaced: slice, off: Sequence[Traversal], on: Sequence[Traversal]
    ) -> tuple[slice, _Stretches] | None:
        """The same where all others stay as they are; None: they have to be formed anew."""
        window_s, stop = self._window_s, replaced.stop
        begins, stretches = self._begins[replaced], self._stretches[replaced]
        for passage in off:
            at = bisect_right(begins, passage) - 1
            if at < 0:
                return None
            if begins[at] == passage and stretches[at].platoons == [[passage]]:
                del begins[at], stretches[at]
                continue
            found = stretches[at].platoon_without(passage)
            if found is None:
                return None
            number, platoon = found
            if begins[at] == passage:
                later = begins[at + 1 : at + 2] or self._begins[stop : stop + 1]
                if later and later[0][0] - platoon[0][0] <= window_s:
                    return None
                begins[at] = platoon[0]
            stretches[at] = stretches[at].replaced(number, platoon, self._kwh(platoon), passage)
        for passage in on:
            at = bisect_right(begins, passage) - 1
            if at >= 0 and not stretches[at].ends_before(passage, window_s):
                found = stretches[at].platoon_with(passage, window_s)
                if found is None:
                    return None
                number, platoon = found
                stretches[at] = stretches[at].replaced(number, platoon, self._kwh(platoon), passage)
                continue
            at += 1
            later = self._begins[stop : stop + 1]
            if at == len(begins) and later and later[0][0] - passage[0] <= window_s:
                begins += later
                stretches.append(self._stretches[stop])
                stop += 1
            if at == len(begins) or begins[at][0] - passage[0] > window_s:
                begins.insert(at, passage)
                stretches.insert(at, Stretch([[passage]], [0.0], frozenset([passage[2][0]])))
                continue
            led = stretches[at].platoon_led_by(passage, window_s)
            if led is None:
                return None
            begins[at] = passage
            stretches[at] = stretches[at].replaced(0, led, self._kwh(led), passage)
        return slice(replaced.start, stop), (begins, stretches)


def _total_kwh(stretches: Sequence[Stretch]) -> float:
    return sum([stretch.total_kwh for stretch in stretches])
