"""Variants of LC-QAOA on the published 25-variable instances and on route options, without noise.

Probabilities are exact: those of the circuit's state, no shots drawn, nothing repaired.
`python -m slipstream_lab.benchmarks.quantum.variants [--short]`
"""

from __future__ import annotations

import argparse
import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from dispatcher_daemon.forms import (
    Problem,
    QuboModel,
    RouteProblem,
    build_model,
    violations,
)
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers import BitDistribution
from dispatcher_daemon.solvers.quantum import (
    ChainAnsatz,
    Ising,
    Prepared,
    prepare_model,
    to_ising,
)
from dispatcher_daemon.solvers.quantum.chain import Ansatz, ChainState, mean_energy, path_weight
from slipstream_lab.benchmarks.quantum.blocks import city_part
from slipstream_lab.research.instances import instance_names, open_instance
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.proofs.enumeration import valid_selections

ERRORS = (0.0013, 0.005)
"""FakeBoston's medians: of a CZ, of a readout."""

_CVAR_SHOTS = 1024
_CITY = (20, 80, 150)
"""Vehicles, stops, segments."""


@dataclass(frozen=True)
class VariantCase:
    """A problem with all its valid selections.

    Attributes:
        valid: bits of the choices, shape (selections, choices).
        best: which of them have the least objective.
    """

    name: str
    model: QuboModel
    valid: npt.NDArray[np.int8]
    best: npt.NDArray[np.bool_]

    @property
    def optimum_kwh(self) -> float:
        """The least objective."""
        first = self.valid[self.best][0]
        return self.model.problem.objective_kwh(np.flatnonzero(first).tolist())


@dataclass(frozen=True)
class Score:
    """Probabilities of valid and of optimal selections, and what the training took."""

    feasible: float
    optimal: float
    rounded: float
    independent: float
    train_s: float
    weight: float


def arc_cases(count: int) -> list[VariantCase]:
    """The named instances of 25 variables."""
    names = [name for name in instance_names() if name.startswith("arc25-")][:count]
    return [case_of(name, arc_form_of(open_instance(name)).problem) for name in names]


def route_cases(count: int, options: int = 25) -> list[VariantCase]:
    """Blocks of so many route options with savings among them, of generated cities."""
    problems = ((seed, city_part(seed, _CITY, options).problem) for seed in itertools.count(1))
    tied = ((seed, problem) for seed, problem in problems if problem.savings)
    return [case_of(f"city {seed}", problem) for seed, problem in itertools.islice(tied, count)]


def case_of(name: str, problem: Problem) -> VariantCase:
    """A problem, its QUBO with the computed γ, and its valid selections by enumeration."""
    if isinstance(problem, RouteProblem):
        chosen = itertools.product(*(group for group in problem.options_of.values() if group))
        sets = [s for s in chosen if not violations(problem, s)]
        valid = np.zeros((len(sets), problem.choices), dtype=np.int8)
        for row, members in enumerate(sets):
            valid[row, list(members)] = 1
    else:
        states = np.flatnonzero(valid_selections(problem))
        valid = ((states[:, None] >> np.arange(problem.choices)) & 1).astype(np.int8)
    values = np.array([problem.objective_kwh(np.flatnonzero(row).tolist()) for row in valid])
    return VariantCase(name, build_model(problem), valid, values <= values.min() + 1e-9)


def score(case: VariantCase, prepared: Prepared) -> Score:
    """What one circuit reaches, and what its one-qubit distributions alone do."""
    bits = np.full((len(case.valid), len(prepared.order)), -1, dtype=np.int8)
    place = np.argsort(prepared.order)[: case.model.problem.choices]
    bits[:, place] = case.valid
    shares = ChainState(prepared.ansatz).probabilities(bits)
    alone = _independent(case, prepared.marginals)
    ising = to_ising(case.model.total, case.model.variables)
    return Score(
        feasible=float(shares.sum()),
        optimal=float(shares[case.best].sum()),
        rounded=float(_rounded(case, prepared.marginals)),
        independent=float(alone[case.best].sum()),
        train_s=prepared.train_s,
        weight=path_weight(ising.coupling, list(prepared.order)) / np.abs(ising.coupling).sum() * 2,
    )


def _independent(case: VariantCase, marginals: BitDistribution) -> npt.NDArray[np.float64]:
    """Probability of each valid selection if bits (or groups) were independent."""
    ones = np.array(marginals.probabilities)[: case.valid.shape[1]]
    zeros = np.ones_like(ones) if marginals.groups else 1 - ones
    return np.asarray(np.where(case.valid == 1, ones, zeros).prod(axis=1))


def _rounded(case: VariantCase, marginals: BitDistribution) -> bool:
    """Whether the likeliest bits (or members of groups) are an optimal selection."""
    ones = np.array(marginals.probabilities)
    bits = (ones > 0.5).astype(np.int8)
    for group in marginals.groups:
        bits[list(group)] = 0
        bits[group[int(ones[list(group)].argmax())]] = 1
    return bool((case.valid[case.best] == bits[: case.valid.shape[1]]).all(axis=1).any())


def survival(prepared: Prepared) -> float:
    """Estimated share of shots without any error on FakeBoston: two CZ for each RZZ or XY gate."""
    tables = [prepared.ansatz.bonds]
    if not isinstance(prepared.ansatz, ChainAnsatz):
        tables += [prepared.ansatz.mixers, prepared.ansatz.spread]
    gates = sum(int(np.count_nonzero(table)) for table in tables)
    gate, readout = ERRORS
    return (1 - gate) ** (2 * gates) * (1 - readout) ** len(prepared.order)


Row = tuple[str, LcQaoaVariant, dict[str, Any]]
"""Title, variant, and what differs from the dispatcher's training: see `prepared_as`."""

ROWS: list[Row] = [
    ("untrained ramp", "ramp", {}),
    ("the paper's: 2p angles, COBYLA, mean", "trained", {}),
    ("the same, random order", "trained", {"random": True}),
    ("2p angles, COBYLA, CVaR 0.1", "trained", {"cvar": 0.1}),
    ("multi-angle, 1 start", "multi-angle", {"restarts": 1}),
    ("multi-angle, 8 starts", "multi-angle", {"restarts": 8}),
    ("multi-angle, 16 starts", "multi-angle", {"restarts": 16}),
    ("multi-angle, 16 starts, random order", "multi-angle", {"restarts": 16, "random": True}),
    ("no RZZ (product), 1 start", "product", {"restarts": 1}),
    ("no RZZ (product), 8 starts", "product", {"restarts": 8}),
    ("no RZZ (product), 16 starts", "product", {"restarts": 16}),
]

ROUTE_ROWS: list[Row] = [
    ("X mixer, 2p angles", "trained", {}),
    ("X mixer, multi-angle, 16 starts", "multi-angle", {"restarts": 16}),
    ("one-hot, 2p angles", "one-hot", {}),
    ("one-hot, multi-angle, 1 start", "one-hot-multi-angle", {"restarts": 1}),
    ("one-hot, multi-angle, 8 starts", "one-hot-multi-angle", {"restarts": 8}),
    ("one-hot, no RZZ (product), 1 start", "one-hot-product", {"restarts": 1}),
    ("one-hot, no RZZ (product), 8 starts", "one-hot-product", {"restarts": 8}),
]


def prepared_as(
    model: QuboModel,
    variant: LcQaoaVariant,
    seed: int,
    *,
    restarts: int = 16,
    random: bool = False,
    cvar: float | None = None,
) -> Prepared:
    """A circuit with training of choice.

    Args:
        restarts: see `prepare_model`.
        random: the chain's order is drawn.
        cvar: share of the samples, lowest energies first, whose mean is trained; None: all.
    """
    order = np.random.default_rng(seed).permutation(len(model.variables)).tolist()
    settings = LcQaoaSettings(variant=variant)
    return prepare_model(
        model,
        settings,
        seed=seed,
        deadline=math.inf,
        restarts=restarts,
        order=order if random else None,
        objective=mean_energy if cvar is None else partial(_cvar, share=cvar, seed=seed),
    )


def _cvar(ising: Ising, share: float, seed: int) -> Callable[[Ansatz], float]:
    """Mean energy of the lowest samples, drawn with the same random numbers each time."""
    kept = max(1, round(share * _CVAR_SHOTS))

    def objective(ansatz: Ansatz) -> float:
        z = 1.0 - 2.0 * ChainState(ansatz).sample(_CVAR_SHOTS, seed)
        drawn = ising.offset + z @ ising.h + ((z @ ising.coupling) * z).sum(axis=1) / 2
        return float(np.partition(drawn, kept - 1)[:kept].mean())

    return objective


def table(
    title: str,
    cases: Sequence[VariantCase],
    rows: Sequence[Row],
    say: Callable[[str], None],
    seeds: int = 1,
) -> None:
    """One line for each variant, the mean over the cases and over so many seeds of each."""
    uniform = np.mean([len(c.valid) / 2.0 ** c.valid.shape[1] for c in cases])
    say(f"\n{title}: {len(cases)} instances, uniform bits are valid in {uniform:.2g}\n")
    say(
        "| variant, p = 2 | P_feas | P_opt | P_opt, median | optimum likeliest | P_opt, "
        "independent bits | chain weight | error-free (est.) | training, s of CPU |"
    )
    say("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for name, variant, options in rows:
        scores, kept, spent = [], [], []
        for seed, case in enumerate([*cases] * seeds, start=1):
            began = time.process_time()
            # Seeds of their own, as the instances are alike: one start would be lucky for all.
            prepared = prepared_as(case.model, variant, seed, **options)
            spent.append(time.process_time() - began)
            scores.append(score(case, prepared))
            kept.append(survival(prepared))
        optimal = [s.optimal for s in scores]
        say(
            f"| {name} | {np.mean([s.feasible for s in scores]):.3g} | {np.mean(optimal):.3g} | "
            f"{np.median(optimal):.3g} | {sum(s.rounded for s in scores):g}/{len(scores)} | "
            f"{np.mean([s.independent for s in scores]):.3g} | "
            f"{np.mean([s.weight for s in scores]):.3f} | {np.mean(kept):.2f} | "
            f"{np.mean(spent):.2f} |"
        )


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="five instances")
    parser.add_argument("--form", choices=("arc", "route"), help="only this form")
    parser.add_argument("--rows", nargs="*", help="only rows whose titles begin with one of these")
    parser.add_argument("--seeds", type=int, default=1, help="of training, for each instance")
    options = parser.parse_args()

    def chosen(rows: list[Row]) -> list[Row]:
        wanted = tuple(options.rows or [""])
        return [row for row in rows if row[0].startswith(wanted)]

    def say(line: str) -> None:
        print(line, flush=True)

    if options.form != "route":
        table("Arc form", arc_cases(5 if options.short else 20), chosen(ROWS), say, options.seeds)
    if options.form != "arc":
        table(
            "Route form",
            route_cases(2 if options.short else 8),
            chosen(ROUTE_ROWS),
            say,
            options.seeds,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
