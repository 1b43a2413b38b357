"""The route-form problem of a few vehicles, all others unchanged."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, combinations, product

from dispatcher_daemon.forms import RouteOption, RouteProblem
from dispatcher_daemon.planning.platooning import Change, Meetings, Traversal
from dispatcher_daemon.planning.routes.itineraries import Itinerary

_NOTHING_KWH = 1e-12

State = tuple[Traversal, ...]
"""Passages of one option on one segment."""


@dataclass(frozen=True)
class Block:
    """Some vehicles and the options of each.

    Attributes:
        options: by vehicle number; the first of each is the present one.
        problem: the same as a `RouteProblem`, options in the same order.
    """

    options: Mapping[int, Sequence[Itinerary]]
    problem: RouteProblem

    def chosen(self, selected: frozenset[int]) -> list[Itinerary]:
        """Itineraries of a selection of the problem's options."""
        every = [option for options in self.options.values() for option in options]
        return [every[i] for i in sorted(selected)]


def build_block(
    names: Mapping[int, str], options: Mapping[int, Sequence[Itinerary]], meetings: Meetings
) -> Block:
    """Costs and pair savings of a block around the present plan.

    Savings on a segment depend on all vehicles there. Here they are expanded around the present
    choice: S ≈ S₀ + Σ Δ_k(r) + Σ Δ_kl(r, q), with Δ_k the change that vehicle k alone makes by
    option r, Δ_kl what k and l together make beyond their single changes. So platoons of three and
    more are exact for every change of one or two vehicles. Changes of more vehicles are estimated
    by their pairs, and are evaluated exactly before they are accepted.

    Args:
        options: by vehicle number, the present one first; all must be on `meetings` as they are.
    """
    lengths = [len(of_one) for of_one in options.values()]
    start = dict(zip(options, accumulate([0, *lengths]), strict=False))
    linear: dict[int, float] = defaultdict(float)
    pairs: dict[tuple[int, int], float] = defaultdict(float)
    for segment in sorted({s for of_one in options.values() for o in of_one for s in o.traversals}):
        _expand(segment, options, start, meetings, linear, pairs)
    shared = _reassignable_stops(options)
    every = [
        RouteOption(
            names[number],
            tuple(stop for stop in option.stops if stop in shared),
            option.cost_kwh - linear[start[number] + r],
        )
        for number, of_one in options.items()
        for r, option in enumerate(of_one)
    ]
    savings = {
        (min(a, b), max(a, b)): value
        for (a, b), value in sorted(pairs.items())
        if abs(value) > _NOTHING_KWH
    }
    vehicles = tuple(names[number] for number in options)
    return Block(options, RouteProblem(vehicles, tuple(sorted(shared)), tuple(every), savings))


def _reassignable_stops(options: Mapping[int, Sequence[Itinerary]]) -> set[str]:
    """Stops that some, but not all options of a vehicle serve."""
    found: set[str] = set()
    for of_one in options.values():
        count = Counter(stop for option in of_one for stop in option.stops)
        found |= {stop for stop, times in count.items() if times < len(of_one)}
    return found


def _expand(
    segment: str,
    options: Mapping[int, Sequence[Itinerary]],
    start: Mapping[int, int],
    meetings: Meetings,
    linear: dict[int, float],
    pairs: dict[tuple[int, int], float],
) -> None:
    """Add one segment's first and second differences to the options' and pairs' savings."""
    moving: dict[int, list[State]] = {}
    for number, of_one in options.items():
        states = [tuple(option.traversals.get(segment, ())) for option in of_one]
        if any(state != states[0] for state in states):
            moving[number] = states
    if not moving or (len(moving) == 1 and all(p[2][0] in moving for p in meetings.on(segment))):
        return
    single = {
        (number, state): _change(segment, meetings, [(states[0], state)])
        for number, states in moving.items()
        for state in dict.fromkeys(states)
        if state != states[0]
    }
    for number, states in moving.items():
        for r, state in enumerate(states):
            if state != states[0]:
                linear[start[number] + r] += single[number, state].saving_kwh
    for (k, of_k), (m, of_m) in combinations(moving.items(), 2):
        together: dict[tuple[State, State], float] = {}
        for a, b in product(dict.fromkeys(of_k), dict.fromkeys(of_m)):
            if a == of_k[0] or b == of_m[0]:
                continue
            one, other = single[k, a], single[m, b]
            if one.touches(other):
                both = _change(segment, meetings, [(of_k[0], a), (of_m[0], b)])
                together[a, b] = both.saving_kwh - one.saving_kwh - other.saving_kwh
        for r, a in enumerate(of_k):
            for q, b in enumerate(of_m):
                extra = together.get((a, b), 0.0)
                if extra:
                    pairs[start[k] + r, start[m] + q] += extra


def _change(segment: str, meetings: Meetings, states: Sequence[tuple[State, State]]) -> Change:
    """What vehicles change that go from one state to another each."""
    off = [p for old, new in states for p in old if p not in new]
    on = [p for old, new in states for p in new if p not in old]
    return meetings.change(segment, off, on)
