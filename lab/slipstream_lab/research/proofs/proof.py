"""Proof that a QUBO is equivalent to its problem, by enumeration of its states and by the MILP."""

from __future__ import annotations

import time
from dataclasses import dataclass

from dispatcher_daemon.forms import (
    MAX_VARIABLES,
    Encoding,
    Problem,
    QuboModel,
    build_model,
)
from dispatcher_daemon.forms.milp import MilpResult, solve_milp
from slipstream_lab.research.proofs.eliminate import MAX_CHOICES, eliminate, largest_part
from slipstream_lab.research.proofs.enumeration import Exactness, enumerate_model

TOLERANCE_KWH = 1e-7
"""Objectives that differ by less are equal: sums of some hundred terms, γ = 50 kWh among them."""

_MILP_DEADLINE_S = 120.0


@dataclass(frozen=True)
class Proof:
    """Result of the checks of one QUBO.

    Attributes:
        choices: number of arcs or options.
        variables: number of variables, auxiliary bits included.
        gamma_kwh: its penalty weight.
        found: by enumeration, whole or in parts.
        milp: by HiGHS, on a model that shares no penalty and no order bit with the QUBO.
        wall_s: time of the enumeration and of the decoder, s.
    """

    choices: int
    variables: int
    gamma_kwh: float
    found: Exactness
    milp: MilpResult
    wall_s: float

    @property
    def equivalent(self) -> bool:
        """Zero penalty ⇔ valid, in every selection."""
        return self.found.mismatches == 0

    @property
    def minimum_matches(self) -> bool:
        """The QUBO's minimum is the MILP's optimum; or by both there is no valid route set."""
        if self.milp.status == "infeasible":
            return self.found.feasible_states == 0
        optimum = self.milp.objective_kwh
        return (
            self.milp.status == "optimal"
            and optimum is not None
            and abs(self.found.minimum_kwh - optimum) <= TOLERANCE_KWH
        )

    @property
    def holds(self) -> bool:
        """All three: equivalence, the minimum, every infeasible state above every feasible one."""
        return self.equivalent and self.minimum_matches and self.found.separated

    def faults(self) -> tuple[str, ...]:
        """What does not hold, in words."""
        found, faults = self.found, []
        if not self.equivalent:
            faults.append(f"{found.mismatches} selections judged unlike the decoder does")
        if not self.minimum_matches:
            faults.append(
                f"QUBO minimum {found.minimum_kwh:.6f} kWh, MILP {self.milp.status} "
                f"{self.milp.objective_kwh} kWh"
            )
        if not found.separated:
            faults.append(
                f"an infeasible state has {found.lowest_infeasible_kwh:.6f} kWh, a feasible one "
                f"{found.highest_feasible_kwh:.6f} kWh"
            )
        return tuple(faults)


def can_prove(model: QuboModel) -> bool:
    """True if a model is small enough, as a whole or in its parts (see `eliminate`)."""
    if len(model.variables) <= MAX_VARIABLES:
        return True
    return model.problem.choices <= MAX_CHOICES and largest_part(model) <= MAX_VARIABLES


def prove(problem: Problem, gamma: float | None = None, encoding: Encoding = "reduced") -> Proof:
    """Check one problem's QUBO.

    Args:
        gamma: penalty weight, kWh; None: the computed bound.
        encoding: of the arc form's subtour terms.

    Raises:
        ValueError: it is too large, see `can_prove`.
    """
    model = build_model(problem, gamma, encoding=encoding)
    began = time.perf_counter()
    whole = len(model.variables) <= MAX_VARIABLES
    found = enumerate_model(model) if whole else eliminate(model)
    wall_s = time.perf_counter() - began
    return Proof(
        choices=problem.choices,
        variables=len(model.variables),
        gamma_kwh=model.gamma,
        found=found,
        milp=solve_milp(problem, _MILP_DEADLINE_S),
        wall_s=wall_s,
    )
