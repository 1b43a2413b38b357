"""Linear-Chain QAOA: trained without a device, sampled in one job, scored with the full QUBO.

Preparation, sampling and scoring are separate steps, as a device may answer late.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dispatcher_daemon.forms import Encoding, Problem, QuboModel, RouteProblem, build_model
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers.distribution import BitDistribution
from dispatcher_daemon.solvers.pace import SolverPace, measure_pace
from dispatcher_daemon.solvers.protocol import Execution, Outcome
from dispatcher_daemon.solvers.quantum.ansatz import linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.backends.base import Backend
from dispatcher_daemon.solvers.quantum.backends.opening import open_backend
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement
from dispatcher_daemon.solvers.quantum.chain.one_hot import (
    group_order,
    inside_groups,
    one_hot_scheduled,
)
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path
from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from dispatcher_daemon.solvers.quantum.chain.training import (
    Schedule,
    around,
    mean_energy,
    train_angles,
    train_schedule,
)
from dispatcher_daemon.solvers.quantum.circuits import circuit_of
from dispatcher_daemon.solvers.quantum.ising import Ising, to_ising
from dispatcher_daemon.solvers.sampling import Bits, Counts, SampledBits, solve_by_sampling, stages

Place = Callable[[int, Sequence[float]], QubitPlacement]
"""`Backend.place`."""

DELTA_BETA = 0.3
DELTA_GAMMA = 0.6
"""Heights of the ramp that training starts from, rad."""
RESTARTS = 16
"""Starting points of training with an angle for each gate."""
SPREAD = 0.5
"""Standard deviation of their angles around the ramp, rad."""

_TRAINING_SHARE = 0.6
"""Share of the deadline for training; the rest is for sampling and post-processing."""

_LEAST_TRAINING_SHARE = 0.3
"""The same where simulated samples take more than the rest: there are fewer of them then."""

_FINISHED_SHARE = 0.85
"""Share of the deadline in which simulated samples are drawn and processed as planned."""

_WAITING_SHARE = 0.9
"""Share of the deadline after which waiting for a device ends."""


class VariantError(ValueError):
    """A variant that does not apply to the problem."""


@dataclass(frozen=True)
class Prepared:
    """A trained circuit and the mapping of its samples; picklable.

    Attributes:
        model: whose QUBO it was trained for.
        order: qubit q of the chain carries variable ``order[q]``.
        ansatz: the circuit as angles.
        variant: of the algorithm.
        energy: ⟨H_total⟩ of the trained state, kWh, exact and without noise.
        evaluations: of the training's objective.
        train_s: time for order and angles, s.
        marginals: the trained state's one-qubit (or one-group) distributions: its control.
    """

    model: QuboModel
    order: tuple[int, ...]
    ansatz: Ansatz
    variant: str
    energy: float
    evaluations: int
    train_s: float
    marginals: BitDistribution


def prepare_model(
    model: QuboModel,
    settings: LcQaoaSettings,
    *,
    seed: int,
    deadline: float,
    place: Place | None = None,
    restarts: int = RESTARTS,
    order: Sequence[int] | None = None,
    objective: Callable[[Ising], Callable[[Ansatz], float]] = mean_energy,
) -> Prepared:
    """The circuit for a model, trained as configured.

    Args:
        seed: of restarts.
        deadline: `time.perf_counter` at which training takes the best so far.
        place: placement of chains on a device; bonds that it cuts get no gate.
        restarts: starting points of training with an angle for each gate.
        order: variables along the chain, of a variant without groups; None: a heavy path.
        objective: what a schedule's training lowers, of a Hamiltonian in chain order.

    Raises:
        VariantError: a one-hot variant of a problem without route options.
    """
    began = time.perf_counter()
    full = to_ising(model.total, model.variables)
    groups: tuple[int, ...] = ()
    if settings.variant.startswith("one-hot"):
        full, order, groups = _in_groups(model, full, settings.variant)
    order = tuple(heavy_path(full.coupling) if order is None else order)
    ordered = full.permuted(order)
    ising = ordered.normalised()
    cuts = () if place is None else _cuts(place, ising, groups)
    starts = np.cumsum(groups)[:-1] - 1 if groups else np.arange(len(order) - 1)
    bonds = np.flatnonzero(np.isin(starts, cuts)).tolist()

    def build(schedule: Schedule) -> Ansatz:
        if groups:
            return one_hot_scheduled(ising, groups, schedule, cuts)
        return scheduled(ising, schedule, cuts)

    start = linear_ramp(settings.layers, DELTA_BETA, DELTA_GAMMA)
    if settings.variant == "ramp":
        ansatz, evaluations = build(start), 0
    else:
        if settings.variant in ("trained", "one-hot"):
            found = train_schedule(
                build,
                objective(ising),
                start,
                evaluations=settings.iterations,
                deadline=deadline,
            )
        else:
            found = train_angles(
                around(build(start), SPREAD, restarts, seed),
                ising,
                iterations=settings.iterations,
                deadline=deadline,
                entangled=not settings.variant.endswith("product"),
                cuts=bonds,
            )
        ansatz, evaluations = found.circuit, found.evaluations
    state = ChainState(ansatz)
    return Prepared(
        model=model,
        order=order,
        ansatz=ansatz,
        variant=settings.variant,
        energy=state.energy(ordered),
        evaluations=evaluations,
        train_s=time.perf_counter() - began,
        marginals=_marginals(state, order, groups),
    )


def _cuts(place: Place, ising: Ising, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Bonds (q, q + 1), by q, that a device cannot lay, at the lightest couplings it can find."""
    weights = np.abs(np.diagonal(ising.coupling, 1))
    if groups:
        between = np.cumsum(groups)[:-1] - 1
        allowed = np.full(len(weights), np.inf)
        allowed[between] = weights[between]
        weights = allowed
    return place(len(ising.h), weights.tolist()).cuts


def _in_groups(
    model: QuboModel, ising: Ising, variant: str
) -> tuple[Ising, tuple[int, ...], tuple[int, ...]]:
    """The Hamiltonian where each vehicle has one option, the chain's order, and its groups."""
    if not isinstance(model.problem, RouteProblem):
        raise VariantError(f"{variant} needs route options: take the route form")
    groups = [list(group) for group in model.problem.options_of.values() if group]
    inside = inside_groups(ising, groups)
    return inside, *group_order(inside.coupling, groups)


def _marginals(
    state: ChainState, order: tuple[int, ...], groups: tuple[int, ...]
) -> BitDistribution:
    ones = np.empty(len(order))
    ones[list(order)] = np.clip((1 - state.means()) / 2, 0.0, 1.0)
    ends = np.cumsum(groups)
    members = [order[end - size : end] for size, end in zip(groups, ends, strict=True)]
    for group in members:
        ones[list(group)] /= ones[list(group)].sum()
    return BitDistribution(tuple(ones.tolist()), tuple(members))


def counts_to_bits(
    counts: Mapping[str, int], order: list[int] | tuple[int, ...]
) -> tuple[Bits, Counts]:
    """Samples as rows of bits by variable, and their counts, in the order of the bit strings.

    Args:
        order: qubit q carries variable ``order[q]``.
    """
    strings = sorted(counts)
    by_qubit = np.array([[int(c) for c in reversed(s)] for s in strings], dtype=np.int8)
    bits = np.empty_like(by_qubit)
    bits[:, list(order)] = by_qubit
    return bits, np.array([counts[s] for s in strings], dtype=np.int64)


@dataclass(frozen=True)
class LcQaoaSolver:
    """LC-QAOA as configured.

    Attributes:
        gamma, encoding: of the QUBO, see `build_model`.
        backend: opens a backend instead of the settings' simulator; a device's use is not limited
            here.
        restarts: see `prepare_model`.
    """

    settings: LcQaoaSettings = field(default_factory=LcQaoaSettings)
    gamma: float | None = None
    encoding: Encoding = "reduced"
    backend: Callable[[], Backend] | None = None
    restarts: int = RESTARTS
    name: str = "lc-qaoa"

    def warm_up(self) -> None:
        """Import Qiskit and Aer and run a circuit, as the first run loads their compiled parts.

        Raises:
            InputError: there is no such backend, or no credentials for it.
        """
        import dwave.samplers  # noqa: F401
        import scipy.optimize  # noqa: F401

        backend = self._opened()
        if backend.kind != "hardware":
            model = Ising(np.array([1.0, -1.0]), np.array([[0.0, 1.0], [1.0, 0.0]]), 0.0)
            backend.sample(circuit_of(scheduled(model, [(0.1, 0.1)])), 16, 1)

    def prepare(
        self, problem: Problem, deadline_s: float, seed: int, place: Place | None = None
    ) -> Prepared:
        """The circuit alone, trained in its share of the deadline; raises as `prepare_model`."""
        model = build_model(problem, self.gamma, encoding=self.encoding)
        deadline = time.perf_counter() + _TRAINING_SHARE * deadline_s
        return self._prepared(model, seed, deadline, place)

    def _prepared(
        self, model: QuboModel, seed: int, deadline: float, place: Place | None
    ) -> Prepared:
        return prepare_model(
            model,
            self.settings,
            seed=seed,
            deadline=deadline,
            place=place,
            restarts=self.restarts,
        )

    def solve(self, problem: Problem, deadline_s: float, seed: int) -> Outcome:
        """See `Solver.solve`; training ends in time to sample, which cannot be cut short.

        A simulator's time for samples is measured before training; where it is too short for all
        shots, there are fewer.
        """
        began = time.perf_counter()
        deadline, finished = (
            began + share * deadline_s for share in (_TRAINING_SHARE, _FINISHED_SHARE)
        )

        def draw(model: QuboModel) -> SampledBits:
            backend, shots, until = self._opened(), self.settings.shots, deadline
            place = None if backend.target is None else backend.place
            pace = None
            if backend.kind != "hardware":
                enough_s = (_FINISHED_SHARE - _TRAINING_SHARE) * deadline_s
                pace = self._pace(model, backend, place, enough_s, seed)
                least = began + _LEAST_TRAINING_SHARE * deadline_s
                until = min(deadline, max(least, finished - pace.time_s(shots)))
            prepared = self._prepared(model, seed, until, place)
            if pace is not None:
                shots = pace.shots_in(finished - time.perf_counter(), shots)
            until = began + _WAITING_SHARE * deadline_s
            return self._draw(prepared, backend, seed, until, shots)

        try:
            return solve_by_sampling(self.name, problem, self.gamma, self.encoding, seed, draw)
        except VariantError as error:
            wall_s = time.perf_counter() - began
            return Outcome(self.name, "failed", None, wall_s, reason=str(error))

    def _opened(self) -> Backend:
        return open_backend(self.settings.backend) if self.backend is None else self.backend()

    def _pace(
        self, model: QuboModel, backend: Backend, place: Place | None, enough_s: float, seed: int
    ) -> SolverPace:
        """Of drawing and processing samples of the circuit before it is trained."""
        one_hot = self.settings.variant.startswith("one-hot")
        untrained = {"variant": "one-hot" if one_hot else "ramp", "iterations": 1}
        settings = self.settings.model_copy(update=untrained)
        prepared = prepare_model(model, settings, seed=seed, deadline=0.0, place=place)
        circuit = circuit_of(prepared.ansatz)

        def take(shots: int) -> None:
            found = backend.sample(circuit, shots, seed)
            stages(model, *counts_to_bits(found.counts, prepared.order), seed)

        return measure_pace(take, self.settings.shots, enough_s)

    def _draw(
        self, prepared: Prepared, backend: Backend, seed: int, until: float, shots: int
    ) -> SampledBits:
        circuit = circuit_of(prepared.ansatz)
        found = backend.sample(circuit, shots, seed, until - time.perf_counter())
        execution = Execution(
            backend=found.backend,
            kind=found.kind,
            variant=prepared.variant,
            layers=self.settings.layers,
            two_qubit_depth=found.two_qubit_depth,
            two_qubit_gates=found.two_qubit_gates,
            train_s=prepared.train_s,
            sample_s=found.sample_s,
            fallback=found.fallback,
            job=found.job,
        )
        bits, counts = counts_to_bits(found.counts, prepared.order)
        controls = (("marginals", prepared.marginals),)
        return SampledBits(bits, counts, len(prepared.order), execution, controls)
