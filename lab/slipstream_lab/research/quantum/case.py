"""One named instance, ready to be solved many times."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from dispatcher_daemon.forms import QuboModel, build_model
from dispatcher_daemon.planning.arc_form import ArcForm
from dispatcher_daemon.solvers import Outcome, Samples, Solver
from slipstream.errors import InputError
from slipstream_lab.research.instances import instance_names, open_instance
from slipstream_lab.research.instances.forms import arc_form_of, attempt
from slipstream_lab.research.instances.instance import Instance
from slipstream_lab.research.proofs.enumeration import valid_selections
from slipstream_lab.research.quantum.controls import UNIFORM_BITS, distributions, run_controls
from slipstream_lab.research.quantum.record import DIGITS, run_record
from slipstream_lab.research.quantum.store import Record

NAMED_SET: Final = "arc25-"
"""What the names of the 20 instances of 25 variables begin with."""


@dataclass
class QuantumCase:
    """An instance in arc form with its proven optimum.

    Attributes:
        number: its place among the published instances; 0 for others.
        optimum_kwh: of H_cost − H_platoon.
        uniform: share of all selections of arcs that are valid, and that are optimal: exact raw
            shares of uniform bits.
    """

    number: int
    instance: Instance
    form: ArcForm
    model: QuboModel
    optimum_kwh: float
    uniform: tuple[float, float]
    _uniform_samples: dict[tuple[int, int], Samples] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The instance's name."""
        return self.instance.name

    def measure(self, solver: Solver, deadline_s: float, seed: int) -> Record:
        """Solve, check, and compare with controls; fields as in `run_record`, and the seed."""
        outcome = solver.solve(self.form.problem, deadline_s, seed)
        return {"seed": seed, **self.judge(outcome, seed)}

    def judge(self, outcome: Outcome, seed: int) -> Record:
        """Figures of an outcome."""
        tried = attempt(self.form, outcome)
        found: dict[str, Any] = {
            "status": outcome.status,
            "reason": outcome.reason,
            "wall_s": outcome.wall_s,
            "repaired": outcome.repaired,
            "best_cost": None
            if tried.candidate is None or outcome.selected is None
            else round(self.form.problem.objective_kwh(outcome.selected), DIGITS),
            "optimal_cost": round(self.optimum_kwh, DIGITS),
            "energy_kwh": None if tried.candidate is None else tried.candidate.driven.total_kwh,
        }
        if outcome.execution is None:
            return found
        controls: dict[str, Samples] = {}
        if outcome.samples is not None:
            controls = self._controls(outcome, outcome.samples.shots, seed)
        exact = {"p_feasible": self.uniform[0], "p_optimal": self.uniform[1]}
        record = run_record(outcome, outcome.execution, controls, self.optimum_kwh)
        return found | record | {"uniform_exact": exact}

    def _controls(self, outcome: Outcome, shots: int, seed: int) -> dict[str, Samples]:
        of = distributions(self.model, outcome)
        uniform = {UNIFORM_BITS: of.pop(UNIFORM_BITS)}
        if (shots, seed) not in self._uniform_samples:
            self._uniform_samples[shots, seed] = run_controls(self.model, uniform, shots, seed)[
                UNIFORM_BITS
            ]
        own = run_controls(self.model, of, shots, seed + 1)
        return {UNIFORM_BITS: self._uniform_samples[shots, seed], **own}


def named_cases(count: int | None = None) -> list[str]:
    """Names of the 25-variable instances, all or the first so many."""
    return [name for name in instance_names() if name.startswith(NAMED_SET)][:count]


def open_case(name: str) -> QuantumCase:
    """A named instance or a file.

    Raises:
        InputError: it has no proven optimum in arc form.
    """
    instance = open_instance(name)
    known, form = instance.known, arc_form_of(instance)
    if known is None or not known.proven or known.form != "arc" or form.unserved:
        raise InputError(
            name, "no proven optimum of its arc form", "take one of solve --list", key="optimum"
        )
    problem = form.problem
    valid = valid_selections(problem)
    optimal = sum(
        problem.objective_kwh([i for i in range(problem.choices) if s >> i & 1])
        <= known.objective_kwh + 1e-9
        for s in valid.nonzero()[0].tolist()
    )
    uniform = (float(valid.mean()), optimal / len(valid))
    number = (*instance_names(), name).index(name) % len(instance_names())
    return QuantumCase(number, instance, form, build_model(problem), known.objective_kwh, uniform)
