"""State-vector QAOA beside Aer's on one circuit: `python -m
slipstream_lab.benchmarks.quantum.statevector`.

Both start from the circuit's angles, simulate it in single precision on all cores and draw the
same number of shots. Aer gets the circuit as gates (H, RZ, RZZ, RX, measurements) and may fuse
them; that the circuit is built and assembled beforehand costs it nothing here. Ours phases with the
energy of every state, which depends on the instance and not on the angles: its time is reported
separately, and the ratio both without and with it.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np

from dispatcher_daemon.forms import build_model
from dispatcher_daemon.solvers.quantum import Ising, linear_ramp, to_ising
from dispatcher_daemon.solvers.quantum.statevector import (
    Diagonal,
    Schedule,
    StateVector,
    cost_diagonal,
)
from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Check, check_table, machine
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of

_AIM = 8.0
_SEED = 1


@dataclass(frozen=True)
class Comparison:
    """Times of both, s, repeat by repeat, and what they drew.

    Attributes:
        couplings: RZZ gates of a layer.
        diagonal_s: the one-off cost of ours, in each repeat.
        ours_s: state and shots, diagonal given.
        aer_s: state and shots.
        ours_energy, aer_energy: mean energy of the shots of the last repeat, normalised.
        error: standard error of their difference.
    """

    instance: str
    machine: str
    qubits: int
    layers: int
    shots: int
    couplings: int
    diagonal_s: list[float]
    ours_s: list[float]
    aer_s: list[float]
    ours_energy: float
    aer_energy: float
    error: float

    @property
    def ratio(self) -> float:
        """How many times as long Aer takes, the diagonal not counted; of medians."""
        return median(self.aer_s) / median(self.ours_s)

    @property
    def ratio_with_diagonal(self) -> float:
        """The same with the diagonal computed for this one run."""
        return median(self.aer_s) / (median(self.ours_s) + median(self.diagonal_s))

    @property
    def agrees(self) -> bool:
        """Whether both drew from one distribution, as far as the mean energy tells."""
        return abs(self.ours_energy - self.aer_energy) < 5 * self.error


def dense_circuit(ising: Ising, schedule: Schedule) -> Any:
    """The measured `qiskit.QuantumCircuit` with all couplings."""
    from qiskit import QuantumCircuit

    n = len(ising.h)
    circuit = QuantumCircuit(n)
    circuit.h(range(n))
    for beta, gamma in schedule:
        for i in range(n):
            circuit.rz(2 * gamma * ising.h[i], i)
        for i, j in zip(*np.nonzero(np.triu(ising.coupling)), strict=True):
            circuit.rzz(2 * gamma * ising.coupling[i, j], int(i), int(j))
        circuit.rx(-2 * beta, range(n))
    circuit.measure_all()
    return circuit


def compare(instance: str, layers: int, shots: int, repeats: int) -> Comparison:
    """Run both in turn, ``repeats`` times.

    Raises:
        InputError: no such instance, or too many qubits.
    """
    from qiskit_aer import AerSimulator

    model = build_model(arc_form_of(open_instance(instance)).problem)
    ising = to_ising(model.total, model.variables).normalised()
    qubits = len(ising.h)
    schedule = linear_ramp(layers, 0.41, 0.83 * layers**0.5)
    circuit = dense_circuit(ising, schedule)
    simulator = AerSimulator(
        method="statevector",
        precision="single",
        max_parallel_threads=os.cpu_count(),
        seed_simulator=_SEED,
    )
    _warm_up(simulator)
    diagonal_s, ours_s, aer_s = [], [], []
    for _ in range(repeats):
        began = time.perf_counter()
        result = simulator.run(circuit, shots=shots).result()
        aer_s.append(time.perf_counter() - began)
        if not result.success:
            raise InputError(instance, f"Aer: {result.status}", "take a smaller instance")
        began = time.perf_counter()
        diagonal = cost_diagonal(ising)
        diagonal_s.append(time.perf_counter() - began)
        began = time.perf_counter()
        state = StateVector(diagonal)
        state.evolve(schedule)
        states, counts = state.sample(shots, _SEED)
        ours_s.append(time.perf_counter() - began)
        del state
    drawn = {int(key, 2): count for key, count in result.get_counts().items()}
    ours = _energy(diagonal, states, counts)
    aer = _energy(diagonal, np.array(list(drawn)), np.array(list(drawn.values())))
    return Comparison(
        instance=instance,
        machine=machine(),
        qubits=qubits,
        layers=layers,
        shots=shots,
        couplings=int(np.count_nonzero(np.triu(ising.coupling))),
        diagonal_s=diagonal_s,
        ours_s=ours_s,
        aer_s=aer_s,
        ours_energy=ours[0],
        aer_energy=aer[0],
        error=float(np.hypot(ours[1], aer[1])),
    )


def _warm_up(simulator: Any) -> None:
    """Load what both load at first, on two qubits."""
    two = Ising(np.ones(2), np.array([[0.0, 1.0], [1.0, 0.0]]), 0.0)
    simulator.run(dense_circuit(two, [(0.1, 0.1)]), shots=1).result()
    StateVector(cost_diagonal(two)).evolve([(0.1, 0.1)])


def _energy(diagonal: Diagonal, states: Any, counts: Any) -> tuple[float, float]:
    """Mean energy of shots, and its standard error."""
    energies, shots = diagonal[states].astype(float), counts.sum()
    mean = float(counts @ energies / shots)
    return mean, float(np.sqrt(counts @ (energies - mean) ** 2) / shots)


def report(found: Comparison) -> str:
    """In Markdown."""
    ratio = found.ratio
    lines = [
        f"{found.instance}: {found.qubits} qubits, {found.couplings} couplings, "
        f"p = {found.layers}, {found.shots} shots, single precision; {found.machine}",
        "",
        "| s | median | runs |",
        "|---|--:|---|",
    ]
    for name, times in (
        ("Aer: state and shots", found.aer_s),
        ("ours: state and shots", found.ours_s),
        ("ours: diagonal, once an instance", found.diagonal_s),
    ):
        lines.append(f"| {name} | {median(times):.2f} | {', '.join(f'{t:.2f}' for t in times)} |")
    lines += [
        "",
        *check_table(
            [
                Check("Aer's time over ours", f"{ratio:.1f}", f"≥ {_AIM:g}", ratio >= _AIM),
                Check("the same, diagonal included", f"{found.ratio_with_diagonal:.1f}", "–", None),
                Check(
                    "mean energy of the shots, ours less Aer's",
                    f"{found.ours_energy - found.aer_energy:+.4f}",
                    f"0 ± {5 * found.error:.4f}",
                    found.agrees,
                ),
            ]
        ),
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 0 if the aim is reached and both agree."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.statevector", description=__doc__
    )
    parser.add_argument("--instance", default="arc25-01-avenue", metavar="NAME|FILE")
    parser.add_argument("--p", type=int, choices=range(1, 11), default=2, metavar="N")
    parser.add_argument("--shots", type=int, default=4096, metavar="N")
    parser.add_argument("--repeats", type=int, choices=range(1, 21), default=3, metavar="N")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args(arguments)
    if options.shots < 1:
        parser.error("--shots must be at least 1")
    try:
        found = compare(options.instance, options.p, options.shots, options.repeats)
    except InputError as error:
        print(f"bench-statevector: {error}", file=sys.stderr)
        return 2
    ratios = {"ratio": found.ratio, "ratio_with_diagonal": found.ratio_with_diagonal}
    print(json.dumps(asdict(found) | ratios, indent=1) if options.json else report(found))
    return 0 if found.ratio >= _AIM and found.agrees else 1


if __name__ == "__main__":
    sys.exit(main())
