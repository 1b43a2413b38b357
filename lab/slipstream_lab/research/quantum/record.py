"""One run of a quantum solver as flat plain data: stages, controls and their differences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, Final

from dispatcher_daemon.solvers import Execution, Outcome, Samples
from slipstream_lab.research.quantum.controls import STAGES, Stage, difference, shares

DIGITS: Final = 9
"""Of costs in kWh, as samples are counted by cost rounded so."""


def run_record(
    outcome: Outcome,
    execution: Execution,
    controls: Mapping[str, Samples],
    optimum_kwh: float | None,
) -> dict[str, Any]:
    """Circuit and backend, and the shares of its samples and of those of its controls.

    Shares carry the stage's name unless they are of raw samples: ``p_feasible``,
    ``p_optimal_descended``. ``best_cost`` is the best objective of any stage, ``optimal_cost`` the
    exact or best known one, both re-evaluated, in kWh and rounded alike. ``added`` holds, for each
    control, every share less the control's, with its standard error.
    """
    record = {
        "variant": execution.variant,
        "p": execution.layers,
        "backend": execution.backend,
        "kind": execution.kind,
        "fallback": execution.fallback,
        "job": execution.job,
        "two_qubit_depth": execution.two_qubit_depth,
        "two_qubit_gates": execution.two_qubit_gates,
        "train_s": execution.train_s,
        "sample_s": execution.sample_s,
        "optimal_cost": None if optimum_kwh is None else round(optimum_kwh, DIGITS),
    }
    samples = outcome.samples
    if samples is None:
        empty = dict.fromkeys((key for _, keys in _keys() for key in keys), None)
        none = {"qubits": None, "shots": None, "best_cost": None, "best_cost_raw": None}
        return record | none | empty | {"controls": {}, "added": {}}
    of_control = {name: _shares(control, optimum_kwh) for name, control in controls.items()}
    of_samples = _shares(samples, optimum_kwh)
    return {
        **record,
        "qubits": samples.qubits,
        "shots": samples.shots,
        **of_samples,
        "controls": of_control,
        "added": {
            name: {
                key: asdict(difference(value, samples.shots, control[key], controls[name].shots))
                for key, value in of_samples.items()
                if key.startswith("p_") and value is not None and control[key] is not None
            }
            for name, control in of_control.items()
        },
    }


def _keys() -> Iterator[tuple[Stage, tuple[str, str]]]:
    """The names of each stage's two shares."""
    for stage in STAGES:
        ending = "" if stage == "raw" else f"_{stage}"
        yield stage, (f"p_feasible{ending}", f"p_optimal{ending}")


def _shares(samples: Samples, optimum_kwh: float | None) -> dict[str, Any]:
    found: dict[str, Any] = {}
    best: list[float] = []
    for stage, (feasible, optimal) in _keys():
        of_stage = shares(samples, stage, optimum_kwh)
        found[feasible], found[optimal] = of_stage.p_feasible, of_stage.p_optimal
        best += [] if of_stage.best_kwh is None else [of_stage.best_kwh]
        if stage == "raw":
            found["best_cost_raw"] = of_stage.best_kwh
    return found | {"best_cost": min(best, default=None)}
