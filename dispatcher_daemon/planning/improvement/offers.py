"""Meetings that solvers of blocks could have chosen, by other ways and departures, and did not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from dispatcher_daemon.planning.improvement.blocks import Block
from dispatcher_daemon.planning.plans import DeclinedMeeting
from dispatcher_daemon.planning.routes.itineraries import Itinerary

_LEAST_KWH = 1e-6


def declined_meetings(
    block: Block, present: Sequence[Itinerary], names: Mapping[int, str], window_s: float
) -> Iterator[DeclinedMeeting]:
    """Pairs of a solved block's options that save something together and were not taken, though
    they are valid; by the block's own expansion of savings.

    Options that serve other stops are left out: what they cost is others' to save.

    Args:
        present: itineraries by vehicle number, those that were taken among the block's.
    """
    every = [(number, option) for number, of_one in block.options.items() for option in of_one]
    problem, taken = block.problem, dict[int, int]()
    for index, (number, option) in enumerate(every):
        if option is present[number]:
            taken[number] = index

    def objective_kwh(a: int, b: int) -> float:
        together = problem.savings.get((min(a, b), max(a, b)), 0.0)
        return problem.options[a].cost_kwh + problem.options[b].cost_kwh - together

    for (a, b), together_kwh in problem.savings.items():
        (k, one), (m, other) = every[a], every[b]
        if together_kwh < _LEAST_KWH or not (k in taken and m in taken):
            continue
        mine, theirs = present[k], present[m]
        if {*one.stops} != {*mine.stops} or {*other.stops} != {*theirs.stops}:
            continue
        segments = _together(one, other, window_s)
        if not segments or set(segments) & set(_together(mine, theirs, window_s)):
            continue
        cost_kwh = one.cost_kwh + other.cost_kwh - mine.cost_kwh - theirs.cost_kwh
        saving_kwh = cost_kwh - objective_kwh(a, b) + objective_kwh(taken[k], taken[m])
        if _LEAST_KWH <= saving_kwh <= cost_kwh:
            yield DeclinedMeeting((names[k], names[m]), segments, cost_kwh, saving_kwh)


def _together(one: Itinerary, other: Itinerary, window_s: float) -> tuple[str, ...]:
    """Segments that two itineraries enter within the window, in the order of the first."""
    found = [
        (mine[0], segment)
        for segment, passages in one.traversals.items()
        for mine in passages
        for theirs in other.traversals.get(segment, ())
        if abs(mine[0] - theirs[0]) <= window_s
    ]
    return tuple(dict.fromkeys(segment for _, segment in sorted(found)))
