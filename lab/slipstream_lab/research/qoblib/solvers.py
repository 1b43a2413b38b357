"""One run of one solver on one instance: exact, routing search, annealing, a circuit, its controls.

A circuit's controls have the processor time that the circuit took, training, sampling and
post-processing together: what they find with it, the circuit has to beat.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from dwave.samplers import SimulatedAnnealingSampler
from scipy.optimize import Bounds, LinearConstraint, milp

from dispatcher_daemon.settings import LcQaoaSettings, SearchSettings
from dispatcher_daemon.solvers import descend, in_order
from dispatcher_daemon.solvers.quantum import Prepared, prepare_model
from dispatcher_daemon.solvers.quantum.chain import ChainState, QubitPlacement
from slipstream_lab.research.instances.matrices import (
    MatrixInstance,
    read_published,
    search_matrix_instance,
)
from slipstream_lab.research.qoblib.cover import Bits, CoverModel, build_cover, check_answer
from slipstream_lab.research.quantum.controls import uniform_bits

SolverName = Literal[
    "exact", "pyvrp", "annealing", "circuit", "marginals", "no-gates", "descent", "uniform"
]
SOLVERS: Final[tuple[SolverName, ...]] = (
    *("exact", "pyvrp", "circuit", "marginals", "no-gates", "descent", "uniform", "annealing"),
)
"""The circuit before those that have its time."""
TIMED_BY_CIRCUIT: Final[frozenset[str]] = frozenset(SOLVERS[3:])
"""Those that have as much processor time as the circuit took."""

Record = dict[str, Any]

_BATCH: Final = 1024
"""Samples that are drawn and descended together."""
_READS: Final = 16
_TRAINING_SHARE: Final = 0.6
_SHARE: Final = 0.9
"""Of the limit, after which a run ends by itself."""
_EPSILON: Final = 1e-6


@dataclass(frozen=True)
class Task:
    """One run.

    Attributes:
        circuit: its settings; shots are those of the circuit alone.
        cpu_s: processor time to spend, building the model not counted; None: the solver's own end.
    """

    solver: SolverName
    path: Path
    seed: int
    circuit: LcQaoaSettings
    limit_s: float
    cpu_s: float | None = None


def warm_up() -> None:
    """Nothing but this module's imports, so that no run's time has them."""


@lru_cache(maxsize=1)
def opened(path: Path) -> tuple[MatrixInstance, CoverModel]:
    """An instance and its model; raises as `read_published` and `build_cover` do."""
    instance = read_published(path, "qoblib")
    return instance, build_cover(instance, path)


def run_task(task: Task) -> Record:
    """Run a solver and check its answer.

    Returns:
        ``cost`` of the checked routes (None without any), ``routes`` by numbers of stops from 1,
        ``bound`` (None: no proof), ``cpu_s`` with the building of the model where it is used,
        ``model_s`` of that, ``wall_s`` without; of samplers ``samples``, ``valid`` (how many choose
        valid routes), ``at_best`` (how many have the cost) and ``missed`` (of the sample that is
        nearest to valid: by how much its rows miss, summed); of the circuit ``raw_valid`` (how many
        were valid before the descent).
    """
    instance, model = opened(task.path)
    began, cpu = time.perf_counter(), time.process_time()
    ends = began + _SHARE * task.limit_s
    found: Record
    if task.solver == "pyvrp":
        found = _search(instance, task)
    elif task.solver == "exact":
        found = _exact(model, task)
    else:
        found = _sampled(model, task, ends, np.inf if task.cpu_s is None else cpu + task.cpu_s)
    model_s = 0.0 if task.solver == "pyvrp" else model.cpu_s
    routes = found.pop("routes")
    cost, reason = (None, None) if routes is None else check_answer(instance, routes)
    return {
        **found,
        "cost": None if reason else cost,
        "reason": reason,
        "routes": None if routes is None else [[n + 1 for n in route] for route in routes],
        "cpu_s": model_s + time.process_time() - cpu,
        "model_s": model_s,
        "wall_s": time.perf_counter() - began,
    }


def _search(instance: MatrixInstance, task: Task) -> Record:
    settings = SearchSettings(workers=1, time_limit_s=_SHARE * task.limit_s)
    with ThreadPoolExecutor(1) as pool:
        plan = search_matrix_instance(instance, settings, pool, task.seed)
    number = {stop.id: i for i, stop in enumerate(instance.fleet.stops)}
    routes = [[number[stop] for stop in stops] for stops in plan.routes.values() if stops]
    return {"routes": None if plan.unserved or plan.faults else routes, "bound": None}


def _exact(model: CoverModel, task: Task) -> Record:
    answer = milp(
        model.costs,
        constraints=LinearConstraint(model.rows, model.targets, model.targets),
        integrality=np.ones(len(model.costs)),
        bounds=Bounds(0, 1),
        options={"time_limit": _SHARE * task.limit_s, "mip_rel_gap": 0.0},
    )
    routes = None if answer.x is None else model.chosen(np.rint(answer.x).astype(np.int8))
    bound = answer.mip_dual_bound
    proven = bound is not None and np.isfinite(bound)
    return {"routes": routes, "bound": float(bound) if proven else None}


@dataclass
class _Tally:
    """What samples are worth."""

    model: CoverModel
    samples: int = 0
    valid: int = 0
    missed: float = np.inf
    cost: float = np.inf
    at_best: int = 0
    best: Bits | None = None
    raw_valid: int | None = None
    extra: Record = field(default_factory=dict)

    def add(self, bits: Bits) -> None:
        misses = np.abs(bits @ self.model.rows.T - self.model.targets).sum(axis=1)
        self.samples += len(bits)
        self.missed = min(self.missed, float(misses.min(initial=np.inf)))
        valid = np.flatnonzero(misses < _EPSILON)
        self.valid += len(valid)
        if len(valid):
            costs = bits[valid] @ self.model.costs
            if costs.min() < self.cost - _EPSILON:
                self.cost, self.best = float(costs.min()), bits[valid[costs.argmin()]]
                self.at_best = 0
            self.at_best += int((costs < self.cost + _EPSILON).sum())

    def record(self) -> Record:
        routes = None if self.best is None else self.model.chosen(self.best)
        return {
            "routes": routes,
            "bound": None,
            "samples": self.samples,
            "valid": self.valid,
            "at_best": self.at_best,
            "raw_valid": self.raw_valid,
            "missed": self.missed,
            **self.extra,
        }


Draw = Callable[[int, int], Bits]
"""(samples, seed) → samples by route."""


def _sampled(model: CoverModel, task: Task, ends: float, cpu_ends: float) -> Record:
    tally, descending, batch = _Tally(model), True, _BATCH
    draw: Draw
    if task.solver == "uniform":
        draw, descending = uniform_bits(len(model.routes)).sample, False
    elif task.solver == "descent":
        draw = uniform_bits(len(model.routes)).sample
    elif task.solver == "annealing":
        draw, descending, batch = _annealing(model, ends), False, _READS
    else:
        prepared = _trained(model, task, gates=task.solver != "no-gates")
        tally.extra = {"energy": prepared.energy, "evaluations": prepared.evaluations}
        draw = prepared.marginals.sample if task.solver == "marginals" else _state(prepared)
    if task.solver == "circuit":
        raw = draw(task.circuit.shots, task.seed)
        tally.raw_valid = int(model.valid(raw).sum())
        tally.add(descend(model.qubo, raw, task.seed))
        return tally.record()
    number = 0
    while True:
        start = time.process_time()
        seed = task.seed + 1_000_003 * number
        bits = draw(batch, seed)
        tally.add(descend(model.qubo, bits, seed) if descending else bits)
        number += 1
        now = time.process_time()
        # As near to the circuit's time as whole batches come.
        if now + (now - start) / 2 >= cpu_ends or time.perf_counter() >= ends:
            return tally.record()


def _trained(model: CoverModel, task: Task, *, gates: bool) -> Prepared:
    def cut_everywhere(n: int, _: object) -> QubitPlacement:
        return QubitPlacement(tuple(range(n)), tuple(range(n - 1)), 1.0)

    return prepare_model(
        model.qubo,
        task.circuit,
        seed=task.seed,
        deadline=time.perf_counter() + _TRAINING_SHARE * task.limit_s,
        place=None if gates else cut_everywhere,
        restarts=1,
    )


def _state(prepared: Prepared) -> Draw:
    state, order = ChainState(prepared.ansatz), list(prepared.order)

    def draw(samples: int, seed: int) -> Bits:
        bits = np.empty((samples, len(order)), dtype=np.int8)
        bits[:, order] = state.sample(samples, seed)
        return bits

    return draw


def _annealing(model: CoverModel, ends: float) -> Draw:
    sampler: Any = SimulatedAnnealingSampler

    def draw(samples: int, seed: int) -> Bits:
        found = sampler().sample(
            model.qubo.total,
            num_reads=samples,
            interrupt_function=lambda: time.perf_counter() >= ends,
            seed=seed % 2**32,
        )
        return in_order(model.qubo, found)

    return draw
