"""Route-form blocks beyond 25 qubits, each as one LC-QAOA: `python -m
slipstream_lab.benchmarks.quantum.large`.

Some vehicles of one generated city choose among their options, all others keep their base routes.
One circuit on the fake device's best chain, with its noise, stands beside blocks of 25 qubits swept
over the same vehicles (LC-QAOA in each, and exactly) and beside the proven optimum.

The approximation ratio is the share of what the optimum gains on the base routes:
(f_base − f) / (f_base − f_optimum); 1 is the optimum, 0 the base routes, below 0 is worse.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.forms import QuboModel, RouteProblem, build_model
from dispatcher_daemon.settings import LcQaoaSettings, LcQaoaVariant
from dispatcher_daemon.solvers import (
    BitDistribution,
    ExactSolver,
    Execution,
    Outcome,
    Samples,
    Solver,
)
from dispatcher_daemon.solvers.quantum import LcQaoaSolver
from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import machine
from slipstream_lab.benchmarks.quantum.blocks import CityPart, city_part, ratio, sweep
from slipstream_lab.research.quantum.controls import (
    STAGES,
    distributions,
    histogram_of,
    run_controls,
    uniform_choices,
)

CITY: Final = (120, 600, 1200)
"""Vehicles, stops, segments."""
SIZES: Final = (50, 100, 150)
_SMALL: Final = 25
_EXACT_S: Final = 60.0
_SOLVE_S: Final = 900.0
_PATIENCE: Final = 1
_MAX_SWEEPS: Final = 4


@dataclass(frozen=True)
class Result:
    """Result of one method.

    Attributes:
        name: of the method.
        qubits: of its largest circuit; None without one.
        depth: two-qubit depth of that circuit as it ran.
        circuits: number of circuits, or of blocks.
        train_s, sample_s: of all circuits, s.
        wall_s: of all of it, s.
        p_feasible: share of the raw shots that are valid; None where there is not one circuit.
        ratios: best approximation ratio of the shots: raw, descended, repaired; of sweeps only one.
        mean_ratio: of the valid raw shots, their mean.
    """

    name: str
    qubits: int | None = None
    depth: int | None = None
    circuits: int = 0
    train_s: float = 0.0
    sample_s: float = 0.0
    wall_s: float = 0.0
    p_feasible: float | None = None
    ratios: tuple[float | None, ...] = (None, None, None)
    mean_ratio: float | None = None


@dataclass(frozen=True)
class LargeBlock:
    """One size.

    Attributes:
        variables: route options.
        vehicles: their number.
        gain_kwh: what the optimum gains on the base routes.
        proven: whether the optimum is.
        found: by each way.
    """

    variables: int
    vehicles: int
    gain_kwh: float
    proven: bool
    found: tuple[Result, ...]


@dataclass(frozen=True)
class LargePlan:
    """What is measured.

    Attributes:
        variants: of LC-QAOA as one circuit.
        swept: variant for the blocks of 25.
        sweeps: whether 25-qubit blocks are swept with LC-QAOA; exact sweeps always are.
    """

    seed: int = 1
    city: tuple[int, int, int] = CITY
    variants: tuple[LcQaoaVariant, ...] = ("one-hot", "one-hot-multi-angle", "multi-angle")
    swept: LcQaoaVariant = "one-hot-multi-angle"
    layers: int = 2
    shots: int = 1000
    iterations: int = 100
    restarts: int = 2
    backend: str = "aer:FakeBoston"
    sweeps: bool = True

    def solver(self, variant: LcQaoaVariant) -> LcQaoaSolver:
        """LC-QAOA as planned."""
        return LcQaoaSolver(
            LcQaoaSettings(
                variant=variant,
                layers=self.layers,
                shots=self.shots,
                iterations=self.iterations,
                backend=self.backend,
            ),
            restarts=self.restarts,
        )


def measure(plan: LargePlan, variables: int) -> LargeBlock:
    """One size, by all methods."""
    part = city_part(plan.seed, plan.city, variables)
    problem = part.problem
    optimum = ExactSolver().solve(problem, _EXACT_S, plan.seed)
    if optimum.selected is None:
        raise RuntimeError(f"no answer at all to {variables} variables")
    start_kwh = problem.objective_kwh(part.start)
    best_kwh = problem.objective_kwh(optimum.selected)
    scale = (start_kwh, best_kwh)
    found = [_swept(plan, part, scale, None)]
    groups = [group for group in problem.options_of.values() if group]
    uniform = uniform_choices(problem.choices, groups)
    found.append(_control(plan, build_model(problem), scale, "uniform options", uniform))
    for variant in plan.variants:
        found += _one_circuit(plan, problem, scale, variant)
    if plan.sweeps:
        found.append(_swept(plan, part, scale, plan.swept))
    return LargeBlock(
        variables,
        len(problem.vehicles),
        start_kwh - best_kwh,
        optimum.status == "optimal",
        tuple(found),
    )


def _one_circuit(
    plan: LargePlan, problem: RouteProblem, scale: tuple[float, float], variant: LcQaoaVariant
) -> Iterator[Result]:
    """The circuit, and uniformly drawn options in its place."""
    try:
        outcome = plan.solver(variant).solve(problem, _SOLVE_S, plan.seed)
    except InputError as error:  # groups that no packing lays on the device
        yield Result(f"one LC-QAOA, {variant}: {error.problem}")
        return
    execution, samples = outcome.execution, outcome.samples
    if execution is None or samples is None:
        yield Result(f"one LC-QAOA, {variant}: {outcome.reason}")
        return
    yield Result(
        name=f"one LC-QAOA, {variant}",
        qubits=samples.qubits,
        depth=execution.two_qubit_depth,
        circuits=1,
        train_s=execution.train_s,
        sample_s=execution.sample_s,
        wall_s=outcome.wall_s,
        p_feasible=samples.share(samples.raw),
        ratios=_ratios(samples, scale),
        mean_ratio=_mean_ratio(samples, scale),
    )
    model = build_model(problem)
    of = distributions(model, outcome)
    yield _control(plan, model, scale, f"its marginals, {variant}", of["marginals"])


def _control(
    plan: LargePlan,
    model: QuboModel,
    scale: tuple[float, float],
    name: str,
    distribution: BitDistribution,
) -> Result:
    """Samples without a circuit, through the same stages."""
    began = time.perf_counter()
    uniform = run_controls(model, {name: distribution}, plan.shots, plan.seed)[name]
    wall_s = time.perf_counter() - began
    return Result(
        name=f"control: {name}",
        wall_s=wall_s,
        p_feasible=uniform.share(uniform.raw),
        ratios=_ratios(uniform, scale),
        mean_ratio=_mean_ratio(uniform, scale),
    )


def _swept(
    plan: LargePlan, part: CityPart, scale: tuple[float, float], variant: LcQaoaVariant | None
) -> Result:
    """Blocks of 25 with all others as they are, by LC-QAOA or exactly."""
    solver: Solver = ExactSolver() if variant is None else plan.solver(variant)
    ran: list[Execution] = []

    def choose(block: RouteProblem, number: int) -> frozenset[int] | None:
        outcome: Outcome = solver.solve(block, _SOLVE_S, plan.seed + number)
        if outcome.execution is not None:
            ran.append(outcome.execution)
        return outcome.selected

    began = time.perf_counter()
    swept = sweep(part, _SMALL, choose, _PATIENCE, _MAX_SWEEPS)
    method = "exactly" if variant is None else f"LC-QAOA, {variant}"
    return Result(
        name=f"blocks of {_SMALL}, {swept.sweeps} sweeps, {method}",
        qubits=None if variant is None else _SMALL,
        depth=max((e.two_qubit_depth or 0 for e in ran), default=None),
        circuits=swept.blocks,
        train_s=sum(e.train_s for e in ran),
        sample_s=sum(e.sample_s for e in ran),
        wall_s=time.perf_counter() - began,
        ratios=(ratio(*scale, swept.objective_kwh),),
    )


def _ratios(samples: Samples, scale: tuple[float, float]) -> tuple[float | None, ...]:
    return tuple(
        ratio(*scale, histogram[0][0]) if histogram else None
        for histogram in (histogram_of(samples, stage) for stage in STAGES)
    )


def _mean_ratio(samples: Samples, scale: tuple[float, float]) -> float | None:
    shots = sum(count for _, count in samples.raw)
    if not shots:
        return None
    return ratio(*scale, sum(value * count for value, count in samples.raw) / shots)


def report(blocks: Sequence[LargeBlock], plan: LargePlan) -> str:
    """In Markdown."""

    def number(value: float | None, digits: int = 2) -> str:
        return "" if value is None else f"{value:.{digits}f}"

    lines = [
        f"City {plan.seed}: {plan.city[0]} vehicles, {plan.city[1]} stops, {plan.city[2]} "
        f"segments; p = {plan.layers}, {plan.shots} shots a circuit, {plan.backend}; {machine()}",
        "",
        "| variables | vehicles | way | 2q depth | circuits | training, s | sampling, s | wall, s "
        "| feasible raw, % | mean ratio raw | best raw | descended | repaired |",
        "|--:|--:|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for block in blocks:
        for way in block.found:
            last = len(way.ratios) == 1
            shown = ("", "", way.ratios[0]) if last else way.ratios
            cells = [
                str(block.variables),
                str(block.vehicles),
                way.name,
                "" if way.depth is None else str(way.depth),
                str(way.circuits or ""),
                number(way.train_s) if way.depth is not None else "",
                number(way.sample_s) if way.depth is not None else "",
                number(way.wall_s) if way.wall_s else "",
                "" if way.p_feasible is None else f"{100 * way.p_feasible:.1f}",
                number(way.mean_ratio, 3),
                *(c if isinstance(c, str) else number(c, 3) for c in shown),
            ]
            lines.append("| " + " | ".join(cells) + " |")
    gains = ", ".join(f"{block.gain_kwh:.4f} kWh ({block.variables})" for block in blocks)
    proven = all(block.proven for block in blocks)
    lines += ["", f"The optimum gains {gains}; {'all' if proven else 'not all'} proven."]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.large", description=__doc__
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), metavar="QUBITS")
    parser.add_argument("--shots", type=int, default=LargePlan().shots, metavar="N")
    parser.add_argument("--seed", type=int, default=LargePlan().seed, metavar="N")
    parser.add_argument("--backend", default=LargePlan().backend, metavar="NAME")
    parser.add_argument("--no-sweeps", action="store_true", help="no sweeps with LC-QAOA")
    options = parser.parse_args(arguments)
    plan = LargePlan(
        seed=options.seed,
        shots=options.shots,
        backend=options.backend,
        sweeps=not options.no_sweeps,
    )
    blocks = []
    for variables in sorted(set(options.sizes)):
        print(f"{variables} qubits", file=sys.stderr, flush=True)
        blocks.append(measure(plan, variables))
    print(report(blocks, plan))
    return 0


if __name__ == "__main__":
    sys.exit(main())
