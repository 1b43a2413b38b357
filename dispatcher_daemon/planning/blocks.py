"""The route-form problem of a few vehicles, all others unchanged."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, combinations

from dispatcher_daemon.planning.itineraries import Itinerary
from dispatcher_daemon.platooning import Meetings, Traversal, clusters
from dispatcher_daemon.problem import RouteOption, RouteProblem

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
        names: of the vehicles.
        options: by vehicle number, the present one first; all must be on `meetings` as they are.
    """
    lengths = [len(of_one) for of_one in options.values()]
    start = dict(zip(options, accumulate([0, *lengths]), strict=False))
    linear: dict[int, float] = defaultdict(float)
    pairs: dict[tuple[int, int], float] = defaultdict(float)
    for segment in sorted({s for of_one in options.values() for o in of_one for s in o.traversals}):
        for outside, states in _encounters(segment, options, meetings):
            _expand(segment, outside, states, start, meetings, linear, pairs)
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


def _encounters(
    segment: str, options: Mapping[int, Sequence[Itinerary]], meetings: Meetings
) -> Iterator[tuple[list[Traversal], dict[int, list[State]]]]:
    """Groups of passages on a segment that can meet: those that stay as they are, and by vehicle
    the states of its options. Only groups in which somebody can change something for two.
    """
    moving: dict[int, list[State]] = {}
    for number, of_one in options.items():
        states = [tuple(option.traversals.get(segment, ())) for option in of_one]
        if any(state != states[0] for state in states):
            moving[number] = states
    if not moving:
        return
    staying = [p for p in meetings.on(segment) if p[2][0] not in moving]
    if not staying and len(moving) == 1:
        return
    changing = {p for states in moving.values() for state in states for p in state}
    for cluster in clusters(sorted({*staying, *changing}), meetings.sync_window_s):
        members = set(cluster)
        here = {
            number: [tuple(p for p in state if p in members) for state in states]
            for number, states in moving.items()
        }
        here = {number: states for number, states in here.items() if any(states)}
        outside = [p for p in staying if p in members]
        if here and (outside or len(here) > 1):
            yield outside, here


def _expand(
    segment: str,
    outside: Sequence[Traversal],
    states: Mapping[int, Sequence[State]],
    start: Mapping[int, int],
    meetings: Meetings,
    linear: dict[int, float],
    pairs: dict[tuple[int, int], float],
) -> None:
    """Add one group's first and second differences to the options' and pairs' savings."""
    present = {number: of_one[0] for number, of_one in states.items()}
    known: dict[tuple[Traversal, ...], float] = {}

    def saved(change: Mapping[int, State]) -> float:
        now = {**present, **change}
        passages = tuple(sorted([*outside, *(p for state in now.values() for p in state)]))
        if passages not in known:
            known[passages] = meetings.saving_kwh(segment, passages)
        return known[passages]

    base = saved({})
    single = {
        (number, state): saved({number: state}) - base
        for number, of_one in states.items()
        for state in dict.fromkeys(of_one)
    }
    for number, of_one in states.items():
        for r, state in enumerate(of_one):
            linear[start[number] + r] += single[number, state]
    for (k, of_k), (m, of_m) in combinations(states.items(), 2):
        together = {
            (a, b): saved({k: a, m: b}) - base - single[k, a] - single[m, b]
            for a in dict.fromkeys(of_k)
            for b in dict.fromkeys(of_m)
            if a != present[k] and b != present[m]
        }
        for r, a in enumerate(of_k):
            for q, b in enumerate(of_m):
                extra = together.get((a, b), 0.0)
                if extra:
                    pairs[start[k] + r, start[m] + q] += extra
