"""Keys of problems, and LC-QAOA's circuits for a device."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from qiskit import QuantumCircuit

from dispatcher_daemon.forms.problem import ArcProblem, RouteProblem
from dispatcher_daemon.settings import LcQaoaSettings
from dispatcher_daemon.solvers.quantum.backends.aer import AerBackend
from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement
from dispatcher_daemon.solvers.quantum.hardware import service
from dispatcher_daemon.solvers.quantum.hardware.circuits import (
    ChainCircuitBuilder,
    Unsuitable,
    problem_key,
)
from dispatcher_daemon.solvers.quantum.lc_qaoa import LcQaoaSolver

Demo = Callable[..., ArcProblem]


def test_costs_and_rewards_do_not_change_the_key(demo_arcs: Demo) -> None:
    """Traffic changes what an arc costs and earns, not which arc it is."""
    problem = demo_arcs(avenue_east=1)
    same = replace(
        problem.without_platooning(),
        arcs=tuple(replace(arc, cost_kwh=2 * arc.cost_kwh) for arc in problem.arcs),
    )
    assert problem_key(problem, "reduced") == problem_key(same, "reduced")
    assert problem_key(problem, "full") != problem_key(problem, "reduced")


def test_other_arcs_or_options_have_another_key(
    demo_arcs: Demo, random_routes: Callable[..., RouteProblem]
) -> None:
    """One arc less, two arcs swapped, another order of stops: other variables."""
    problem = demo_arcs()
    fewer = replace(problem, arcs=problem.arcs[:-1], rewards=())
    swapped = replace(problem, arcs=problem.arcs[::-1], rewards=())
    routes = random_routes(1, (3, 3), 2)
    options = (replace(routes.options[0], stops=("s1",)), *routes.options[1:])
    other = replace(routes, options=options)
    names = {problem_key(p, "") for p in (problem, fewer, swapped, routes, other)}
    assert len(names) == 5


@pytest.fixture(scope="module")
def builder() -> ChainCircuitBuilder:
    """LC-QAOA along the ramp."""
    return ChainCircuitBuilder(LcQaoaSolver(LcQaoaSettings(variant="ramp", shots=64)))


def test_a_circuit_and_its_samples_go_through_the_device(
    builder: ChainCircuitBuilder, demo_arcs: Demo
) -> None:
    """Built, pickled, sampled elsewhere, read back, scored on the problem at hand."""
    problem = demo_arcs(avenue_east=1)
    built = builder.build(problem, 5.0, 1)
    assert built.circuit.num_qubits == len(built.order)
    assert sorted(built.order) == list(range(len(built.order)))
    assert built.fingerprint == builder.build(problem, 5.0, 1).fingerprint
    counts = AerBackend().sample(pickle.loads(pickle.dumps(built.circuit)), 256, 3).counts
    read = builder.decode(problem, built.order, counts, 1)
    assert read.selected is not None
    assert read.samples is not None
    assert (read.samples.shots, read.samples.qubits) == (256, len(built.order))
    # Whatever they were drawn for, they are scored on the problem at hand.
    dearer = replace(
        problem, arcs=tuple(replace(a, cost_kwh=a.cost_kwh + 1.0) for a in problem.arcs)
    )
    other = builder.decode(dearer, built.order, counts, 1)
    assert other.samples is not None
    low, high = read.samples.descended[0][0], other.samples.descended[0][0]
    assert high > low + 1.0


def test_the_variable_order_is_kept(builder: ChainCircuitBuilder, demo_arcs: Demo) -> None:
    """A single sample comes back as the selection that it stands for."""
    problem = demo_arcs()
    built = builder.build(problem, 5.0, 1)
    exact = builder.decode(
        problem, built.order, AerBackend().sample(built.circuit, 512, 1).counts, 1
    ).selected
    assert exact is not None
    bits = np.zeros(len(built.order), dtype=int)
    bits[list(exact)] = 1
    # Qubit q carries variable order[q], and Qiskit writes qubit 0 last.
    string = "".join(str(bits[variable]) for variable in reversed(built.order))
    again = builder.decode(problem, built.order, {string: 1}, 1)
    assert again.samples is not None
    assert again.selected is not None
    assert problem.objective_kwh(again.selected) <= problem.objective_kwh(exact) + 1e-9


def test_another_width_is_no_answer(builder: ChainCircuitBuilder, demo_arcs: Demo) -> None:
    """Samples of another number of variables are not forced onto a problem."""
    outcome = builder.decode(demo_arcs(), (1, 0), {"01": 3}, 1)
    assert outcome.selected is None
    assert "another number of variables" in (outcome.reason or "")


def test_problems_without_a_circuit_say_so(demo_arcs: Demo) -> None:
    """Nothing to choose, or a variant that the form does not have."""
    plain = ChainCircuitBuilder(LcQaoaSolver(LcQaoaSettings(variant="ramp")))
    with pytest.raises(Unsuitable, match="nothing to choose"):
        plain.build(ArcProblem("d", (), ("v",), ()), 5.0, 1)
    one_hot = ChainCircuitBuilder(LcQaoaSolver(LcQaoaSettings(variant="one-hot")))
    with pytest.raises(Unsuitable, match="route"):
        one_hot.build(demo_arcs(), 5.0, 1)


def test_a_chain_is_cut_where_the_device_has_no_edge(
    builder: ChainCircuitBuilder, demo_arcs: Demo
) -> None:
    """A device that cannot lay the whole chain gets a circuit without gates at its cuts."""

    def place(n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        return QubitPlacement(tuple(range(n)), (2,), 1.0)

    def gated(circuit: QuantumCircuit) -> set[int]:
        pairs = [i.qubits for i in circuit.data if len(i.qubits) == 2]
        return {min(circuit.find_bit(q).index for q in pair) for pair in pairs}

    problem = demo_arcs(avenue_east=1)
    opened = SimpleNamespace(
        name="cut",
        place=place,
        estimate_s=lambda circuit, shots: 1.0,
        two_qubit=lambda circuit: (4, 4),
    )
    prepared = service.prepare(_Opens(opened), builder, problem, 5.0, 1, 64)
    whole = gated(builder.build(problem, 5.0, 1).circuit)
    assert 2 in whole
    assert gated(pickle.loads(prepared.built.circuit)) == whole - {2}


class _Opens:
    """Opens a service that is there."""

    max_age_s = 0.0

    def __init__(self, service: Any) -> None:
        self._service = service

    def __call__(self) -> Any:
        return self._service
