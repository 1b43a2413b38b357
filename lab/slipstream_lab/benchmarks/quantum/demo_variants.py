"""Which circuit is worth a demo's time: processor time, valid and optimal samples, by variant.

    python -m slipstream_lab.benchmarks.quantum.demo_variants

Four published instances in route form, three seeds each; some minutes. Prints a line a variant.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from typing import Any, Final

from dispatcher_daemon.forms import RouteProblem, build_model
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers import ExactSolver
from dispatcher_daemon.solvers.quantum import LcQaoaSolver
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import route_form_of
from slipstream_lab.research.quantum.controls import UNIFORM_BITS, distributions, run_controls

_INSTANCES: Final = ("arc25-01-avenue", "arc25-06-ring", "arc25-09-motorway", "arc25-12-valley")
_SEEDS: Final = (1, 2, 3)
_DEADLINE_S: Final = 10.0
_FEW: Final[dict[str, Any]] = {"shots": 512, "iterations": 20}
_ONE: Final[dict[str, Any]] = {"shots": 512, "layers": 1}
_VARIANTS: Final[tuple[dict[str, Any], ...]] = (
    {"variant": "trained"},
    {"variant": "trained", **_FEW},
    {"variant": "ramp", **_ONE},
    {"variant": "product", **_ONE, "restarts": 4},
    {"variant": "multi-angle", **_ONE, "restarts": 4},
    {"variant": "one-hot"},
    {"variant": "one-hot", "shots": 512},
    {"variant": "one-hot", **_FEW},
    {"variant": "one-hot", **_FEW, **_ONE},
)


def main() -> None:
    """Measure and print."""
    problems = [route_form_of(open_instance(name)).problem for name in _INSTANCES]
    best = [_optimum(problem) for problem in problems]
    for given in _VARIANTS:
        settings = LcQaoaSettings.model_validate(given)
        rows = [
            _run(problem, optimum, settings, seed)
            for problem, optimum in zip(problems, best, strict=True)
            for seed in _SEEDS
        ]
        print(given, _line(rows), flush=True)


def _optimum(problem: RouteProblem) -> float:
    selected = ExactSolver().solve(problem, _DEADLINE_S, 1).selected
    if selected is None:
        raise RuntimeError("no exact answer: the machine is too slow")
    return problem.objective_kwh(selected)


def _run(
    problem: RouteProblem, optimum: float, settings: LcQaoaSettings, seed: int
) -> dict[str, float]:
    """CPU s, shares of the circuit and of its controls, and whether the answer is the optimum."""
    solver = LcQaoaSolver(settings)
    solver.warm_up()
    began = time.process_time()
    outcome = solver.solve(problem, _DEADLINE_S, seed)
    cpu_s = time.process_time() - began
    samples, model = outcome.samples, build_model(problem)
    if samples is None:
        raise RuntimeError(outcome.reason)
    controls = run_controls(model, distributions(model, outcome), samples.shots, seed)
    marginals, uniform = controls["marginals"], controls[UNIFORM_BITS]
    found = outcome.selected
    return {
        "cpu_s": cpu_s,
        "p_feasible": samples.share(samples.raw),
        "p_optimal": samples.share(samples.raw, optimum),
        "marginals": marginals.share(marginals.raw, optimum),
        "uniform, repaired": uniform.share(uniform.repaired, optimum),
        "optimum": float(found is not None and problem.objective_kwh(found) <= optimum + 1e-9),
        "shots": float(samples.shots),
    }


def _line(rows: Sequence[dict[str, float]]) -> str:
    def cell(key: str) -> str:
        values = [row[key] for row in rows]
        return f"{key} {statistics.mean(values):.4g} ± {statistics.pstdev(values):.2g}"

    return f"{len(rows)} runs: " + ", ".join(cell(key) for key in rows[0])


if __name__ == "__main__":
    main()
