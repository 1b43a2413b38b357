"""Block-coordinate descent: each block is solved with the others fixed, until nothing improves."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from dispatcher_daemon.forms import violations
from dispatcher_daemon.planning.improvement.blocks import Block, build_block
from dispatcher_daemon.planning.improvement.carriers import Accounts
from dispatcher_daemon.planning.improvement.departures import (
    as_planned,
    best_departure,
    longest_wait_s,
    schedule_greedily,
)
from dispatcher_daemon.planning.improvement.exchanges import best_exchanges, exchanged
from dispatcher_daemon.planning.improvement.offers import declined_meetings
from dispatcher_daemon.planning.improvement.options import options_for
from dispatcher_daemon.planning.improvement.partition import blocks_of, opportunity_graph
from dispatcher_daemon.planning.plans import DeclinedMeeting
from dispatcher_daemon.planning.roads import Route
from dispatcher_daemon.planning.routes.itineraries import Itinerary, Planner
from dispatcher_daemon.planning.routes.pyvrp_model import StopsByVehicle
from dispatcher_daemon.settings import CitySettings
from dispatcher_daemon.solvers import Outcome
from dispatcher_daemon.solvers.workers import PoolJob, Solve
from slipstream.service.tracing import traced

_BETTER_KWH = 1e-9
_LEAST_S = 0.05
"""Time that is worth a block."""
_LEAST_TRIAL_S = 1.0
"""Time that is worth a circuit."""


@dataclass(frozen=True)
class Choice:
    """The itineraries of all vehicles with their cost and saving.

    Attributes:
        itineraries: by vehicle number.
        cost_kwh: H_cost, and the cost of waiting at depots.
        saving_kwh: H_platoon, platoons counted once.
    """

    itineraries: tuple[Itinerary, ...]
    cost_kwh: float
    saving_kwh: float

    @property
    def objective_kwh(self) -> float:
        """H_cost − H_platoon."""
        return self.cost_kwh - self.saving_kwh

    @property
    def routes(self) -> tuple[Route, ...]:
        """Of the vehicles that drive."""
        return tuple(i.route for i in self.itineraries if i.route is not None)


@dataclass(frozen=True)
class Sweep:
    """One sweep.

    Attributes:
        largest: variables of the largest one.
        accepted: number of answers that improved the plan, by solver.
    """

    blocks: int
    variables: int
    largest: int
    accepted: Mapping[str, int]
    outcomes: tuple[Outcome, ...]
    objective_kwh: float
    wall_s: float


@dataclass(frozen=True)
class Trial:
    """The answer of a solver that is asked for one block of a plan only.

    Attributes:
        objective_kwh: that the whole plan has with its answer; None without a valid one.
        optimum_kwh: the block's, where a solver has proven it.
        accepted: whether the answer improved the plan.
    """

    outcome: Outcome
    objective_kwh: float | None = None
    optimum_kwh: float | None = None
    accepted: bool = False


def choice_of(planner: Planner, itineraries: Sequence[Itinerary]) -> Choice:
    """Cost and saving of itineraries, evaluated exactly."""
    meetings = planner.book.meetings()
    saving = math.fsum(meetings.add(itinerary.traversals) for itinerary in itineraries)
    cost = math.fsum(itinerary.cost_kwh for itinerary in itineraries)
    return Choice(tuple(itineraries), cost, saving)


def scheduled(
    planner: Planner, base: Choice, has_time: Callable[[], bool] = lambda: True
) -> Choice:
    """The same routes with departures chosen one vehicle after the other.

    Bound vehicles begin with the waits of their present plans: the schedule is those waits, or the
    greedy one from them on if that is better.

    Args:
        has_time: whether another vehicle may be scheduled; the others stay as they are.
    """
    planned = [as_planned(planner, itinerary) for itinerary in base.itineraries]
    bound = any(a is not b for a, b in zip(planned, base.itineraries, strict=True))
    # Vehicles that are ready last choose first: the others can wait for them, not vice versa.
    latest_first = sorted(planned, key=lambda i: (-i.depart_s, i.number))
    chosen = schedule_greedily(planner, takewhile(lambda _: has_time(), latest_first))
    chosen += latest_first[len(chosen) :]
    in_order = sorted(chosen, key=lambda i: i.number)
    schedules = [choice_of(planner, planned) if bound else base, choice_of(planner, in_order)]
    return min(schedules, key=lambda choice: choice.objective_kwh)


class BlockDescent:
    """The present choice of all vehicles, improved block by block.

    Attributes:
        declined: by pair of vehicles, the meeting of the last sweep that would have cost least.
    """

    def __init__(
        self,
        planner: Planner,
        settings: CitySettings,
        solve: Solve,
        itineraries: Sequence[Itinerary],
    ) -> None:
        self.planner, self.settings = planner, settings
        self.present = list(itineraries)
        self.declined: dict[tuple[str, str], DeclinedMeeting] = {}
        self._solve = solve
        self._meetings = planner.book.meetings()
        saving = math.fsum(self._meetings.add(i.traversals) for i in itineraries)
        self._objective_kwh = math.fsum(i.cost_kwh for i in itineraries) - saving
        self._accounts: Accounts | None = None
        self._last: list[Block] = []
        self._names = {n: v.id for n, v in enumerate(planner.problem.fleet.vehicles)}

    def keep_to(self, accounts: Accounts) -> None:
        """Go on from the plan of some accounts, with changes only that they allow."""
        self._objective_kwh += self._apply(accounts.present)
        self._accounts = accounts

    @traced("blocks")
    def run(
        self, seed: int, ends: float, clock: Callable[[], float]
    ) -> tuple[tuple[Sweep, ...], bool]:
        """Sweep until nothing improves, or for `settings.max_sweeps`.

        Returns:
            (the sweeps, whether the deadline ended them).
        """
        sweeps: list[Sweep] = []
        idle = 0
        while len(sweeps) < self.settings.max_sweeps and idle < self.settings.patience:
            sweep = self._sweep(seed + len(sweeps), ends, clock)
            if sweep is None:
                return tuple(sweeps), True
            sweeps.append(sweep)
            idle = 0 if sweep.accepted else idle + 1
        return tuple(sweeps), False

    def _sweep(self, seed: int, ends: float, clock: Callable[[], float]) -> Sweep | None:
        began = clock()
        planner, max_variables = self.planner, self.settings.block_variables
        windows = [planner.windows.of(i.number) for i in self.present]
        waits = [longest_wait_s(planner, i) for i in self.present]
        graph = opportunity_graph(
            self.present, windows, waits, planner.book.shares, planner.book.sync_window_s
        )
        size = max(2, max_variables // self.settings.options)
        # A small fleet is one block: exchanges can tie vehicles that have no road in common yet.
        small = 0 < len(graph) <= size
        groups = [sorted(graph)] if small else blocks_of(graph, size, seed)
        solved: list[tuple[Block, list[Outcome]]] = []
        self.declined = {}
        rng = np.random.default_rng(seed)
        accepted: Counter[str] = Counter()
        # In batches, solved in parallel: later ones start from what earlier ones changed.
        shuffled = [groups[i] for i in rng.permutation(len(groups))]
        for batch in _batches(shuffled, self.settings.wave):
            blocks = []
            for group in batch:
                if ends - clock() < _LEAST_S:
                    return None
                blocks.append(self._block(group, max_variables, rng))
            left_s = max(_LEAST_S, ends - clock())
            answers = self._solve_blocks(blocks, min(left_s, self.settings.block_deadline_s), seed)
            for block, outcomes in zip(blocks, answers, strict=True):
                accepted.update(self._accept_best(block, outcomes))
                self._note_declined(block)
                solved.append((block, outcomes))
        self._last = [block for block, _ in solved]
        return Sweep(
            len(solved),
            sum(block.problem.choices for block, _ in solved),
            max((block.problem.choices for block, _ in solved), default=0),
            accepted,
            tuple(outcome for _, outcomes in solved for outcome in outcomes),
            self._objective_kwh,
            clock() - began,
        )

    @traced("trials")
    def try_solvers(
        self, names: Sequence[str], seed: int, ends: float, clock: Callable[[], float]
    ) -> tuple[Trial, ...]:
        """Ask further solvers, and those of all blocks beside them, for the block of the last
        sweep whose options save most together; an answer that improves the plan is accepted.
        """
        if not self._last:
            return ()
        left_s = min(ends - clock(), self.settings.block_deadline_s)
        if left_s < _LEAST_TRIAL_S:
            why = f"{max(0.0, left_s):.1f} s were left for it"
            return tuple(Trial(Outcome(name, "timeout", None, 0.0, reason=why)) for name in names)
        # Built anew: blocks that were solved later may have changed what is around it.
        chosen, rng = max(self._last, key=_at_stake_kwh), np.random.default_rng(seed)
        block = self._block(list(chosen.options), self.settings.block_variables, rng)
        every = (*self.settings.solvers, *names)
        outcomes = self._solve([PoolJob(n, block.problem, seed) for n in every], left_s)
        found_kwh = [self._with_kwh(block, outcome) for outcome in outcomes]
        proven = [
            block.problem.objective_kwh(outcome.selected)
            for outcome in outcomes
            if outcome.status == "optimal" and outcome.selected is not None
        ]
        accepted = self._accept_best(block, outcomes)
        return tuple(
            Trial(outcome, kwh, min(proven, default=None), outcome.solver in accepted)
            for outcome, kwh in zip(outcomes, found_kwh, strict=True)
            if outcome.solver in names
        )

    def _with_kwh(self, block: Block, outcome: Outcome) -> float | None:
        """The exact objective of the plan with an answer; None without a valid one."""
        if outcome.selected is None or not _is_valid(block, outcome.selected):
            return None
        return self._objective_kwh + self._tried(block, block.chosen(outcome.selected))

    def _tried(self, block: Block, chosen: Sequence[Itinerary]) -> float:
        """What a choice would change, kWh; the present one stays."""
        change = self._apply(chosen)
        self._apply([block.options[i.number][0] for i in chosen])
        return change

    def adopt(
        self, stops: StopsByVehicle, seed: int, ends: float, clock: Callable[[], float]
    ) -> int:
        """Adopt from other routes what improves the plan, exchange by exchange.

        Returns:
            number of exchanges adopted.
        """
        adopted = 0
        for group in self._exchanges(stops):
            if clock() > ends:
                break
            for number in group:
                self._meetings.remove(self.present[number].traversals)
            # Of a group in which time runs out, what is not known yet is taken for impossible.
            others = [
                self._itinerary_by(number, stops) if clock() < ends else None for number in group
            ]
            for number, other in zip(group, others, strict=True):
                if other is not None:
                    self._meetings.remove(other.traversals)
                self._meetings.add(self.present[number].traversals)
            found = [other for other in others if other is not None]
            if len(found) < len(group):
                continue
            options = {o.number: [self.present[o.number], o] for o in found}
            if 2 * len(group) > self.settings.block_variables:
                change = self._apply(found)
                if change < -_BETTER_KWH:
                    self._objective_kwh += change
                    adopted += 1
                else:
                    self._apply([of_one[0] for of_one in options.values()])
                continue
            block = build_block(self._names, options, self._meetings)
            left_s = max(_LEAST_S, ends - clock())
            answers = self._solve_blocks([block], min(left_s, self.settings.block_deadline_s), seed)
            adopted += len(self._accept_best(block, answers[0]))
        return adopted

    def _exchanges(self, stops: StopsByVehicle) -> list[list[int]]:
        """Groups of one carrier's vehicles among which other routes serve the same stops."""
        others = {number: stops[name] for number, name in self._names.items()}
        vehicles = self.planner.problem.fleet.vehicles
        return [
            group
            for group in exchanged(self.present, others)
            if len({vehicles[number].carrier for number in group}) == 1
        ]

    def _itinerary_by(self, number: int, stops: StopsByVehicle) -> Itinerary | None:
        """A vehicle's best itinerary by other routes; its passages are added to the meetings."""
        visits = stops[self._names[number]]
        candidates = []
        for travel in range(len(self.planner.travels)):
            legs = self.planner.legs(number, visits, travel)
            candidate = self.planner.itinerary(number, visits, legs)
            if candidate is not None:
                candidates.append(best_departure(self.planner, candidate, self._meetings))
        if not candidates:
            return None
        best = max(candidates, key=lambda c: self._meetings.gain_kwh(c.traversals) - c.cost_kwh)
        self._meetings.add(best.traversals)
        return best

    def _block(self, group: Sequence[int], max_variables: int, rng: np.random.Generator) -> Block:
        members = [self.present[n] for n in group]
        # What is loaded stays where it is.
        open_to_change = [i for i in members if i.number not in self.planner.windows.bound]
        exchanges = best_exchanges(self.planner, open_to_change, self._meetings, 1, rng)
        exchange = [itinerary for pair in exchanges for itinerary in pair]
        if 2 * len(group) + len(exchange) > max_variables:
            exchange = []
        each = (max_variables - len(exchange)) // len(group)
        options = {
            n: options_for(self.planner, self.present[n], members, self._meetings, each, rng)
            for n in group
        }
        for itinerary in exchange:
            options[itinerary.number].append(itinerary)
        return build_block(self._names, options, self._meetings)

    def _solve_blocks(
        self, blocks: Sequence[Block], deadline_s: float, seed: int
    ) -> list[list[Outcome]]:
        names = self.settings.solvers
        jobs = [PoolJob(name, block.problem, seed) for block in blocks for name in names]
        outcomes = self._solve(jobs, deadline_s)
        return [outcomes[i : i + len(names)] for i in range(0, len(outcomes), len(names))]

    def _accept_best(self, block: Block, outcomes: Sequence[Outcome]) -> tuple[str, ...]:
        """Accept the answer that improves the exact objective most; its solver, or nothing."""
        best_change, best, solver = -_BETTER_KWH, None, ""
        seen = set()
        for outcome in outcomes:
            selected = outcome.selected
            if selected is None or selected in seen or not _is_valid(block, selected):
                continue
            seen.add(selected)
            chosen = block.chosen(selected)
            change = self._tried(block, chosen)
            if change < best_change and (self._accounts is None or self._accounts.allows(chosen)):
                best_change, best, solver = change, chosen, outcome.solver
        if best is None:
            return ()
        self._objective_kwh += self._apply(best)
        if self._accounts is not None:
            self._accounts.change(best)
        return (solver,)

    def _note_declined(self, block: Block) -> None:
        for one in declined_meetings(
            block, self.present, self._names, self.planner.book.sync_window_s
        ):
            known = self.declined.get(one.vehicles)
            loss_kwh = one.cost_kwh - one.saving_kwh
            if known is None or loss_kwh < known.cost_kwh - known.saving_kwh:
                self.declined[one.vehicles] = one

    def _apply(self, itineraries: Sequence[Itinerary]) -> float:
        """Change some vehicles' itineraries; the change of the objective, kWh."""
        change = 0.0
        for itinerary in itineraries:
            old = self.present[itinerary.number]
            if old is itinerary:
                continue
            change += itinerary.cost_kwh - old.cost_kwh
            change -= self._meetings.remove(old.traversals)
            change -= self._meetings.add(itinerary.traversals)
            self.present[itinerary.number] = itinerary
        return change


def _at_stake_kwh(block: Block) -> float:
    return math.fsum(map(abs, block.problem.savings.values()))


def _is_valid(block: Block, selected: frozenset[int]) -> bool:
    known = all(0 <= index < block.problem.choices for index in selected)
    return known and not violations(block.problem, selected)


def _batches(groups: Sequence[list[int]], size: int) -> list[Sequence[list[int]]]:
    return [groups[i : i + size] for i in range(0, len(groups), size)]
