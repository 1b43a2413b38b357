"""State-vector QAOA beside Aer's on one circuit: `python -m
slipstream_lab.benchmarks.quantum.statevector`.

Both start from the circuit's angles, simulate it in single precision on all cores and draw the
same number of shots. Aer gets the circuit as gates and may fuse them; that it is built beforehand
costs it nothing here. Ours phases with the energy of every state, which depends on the instance and
not on the angles: its time is reported separately, and the ratio both without and with it.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any, Final, TypeVar

import numpy as np

from dispatcher_daemon.forms import build_model
from dispatcher_daemon.solvers.quantum import Ising, ramp_of, to_ising
from dispatcher_daemon.solvers.quantum.statevector import Diagonal, StateVector, cost_diagonal
from slipstream.errors import InputError
from slipstream_lab.benchmarks.aims import Check, check_table, machine
from slipstream_lab.research.instances import open_instance
from slipstream_lab.research.instances.forms import arc_form_of
from slipstream_lab.research.quantum.dense import dense_qaoa_circuit

_AIM: Final = 8.0
_SEED: Final = 1
T = TypeVar("T")


def compare(instance: str, layers: int, shots: int, repeats: int) -> list[Check]:
    """Run both in turn, ``repeats`` times: the aim, and whether both drew from one distribution.

    Raises:
        InputError: no such instance, or too many qubits.
    """
    from qiskit_aer import AerSimulator

    model = build_model(arc_form_of(open_instance(instance)).problem)
    ising = to_ising(model.total, model.variables).normalised()
    schedule = ramp_of("x", layers)
    circuit = dense_qaoa_circuit(ising, schedule)
    simulator = AerSimulator(
        method="statevector",
        precision="single",
        max_parallel_threads=os.cpu_count(),
        seed_simulator=_SEED,
    )
    # Load what both load at first, on two qubits.
    two = Ising(np.ones(2), np.array([[0.0, 1.0], [1.0, 0.0]]), 0.0)
    simulator.run(dense_qaoa_circuit(two, [(0.1, 0.1)]), shots=1).result()
    StateVector(cost_diagonal(two)).evolve([(0.1, 0.1)])

    def ours(diagonal: Diagonal) -> tuple[Any, Any]:
        state = StateVector(diagonal)
        state.evolve(schedule)
        return state.sample(shots, _SEED)

    diagonal_s, ours_s, aer_s = [], [], []
    for _ in range(repeats):
        took_s, result = _timed(lambda: simulator.run(circuit, shots=shots).result())
        aer_s.append(took_s)
        if not result.success:
            raise InputError(instance, f"Aer: {result.status}", "take a smaller instance")
        took_s, diagonal = _timed(lambda: cost_diagonal(ising))
        diagonal_s.append(took_s)
        took_s, (states, counts) = _timed(lambda diagonal=diagonal: ours(diagonal))  # type: ignore[misc]
        ours_s.append(took_s)
    drawn = {int(key, 2): count for key, count in result.get_counts().items()}
    mean, error = _energy(diagonal, states, counts)
    aer_mean, aer_error = _energy(diagonal, np.array(list(drawn)), np.array(list(drawn.values())))
    off, allowed = mean - aer_mean, 5 * float(np.hypot(error, aer_error))
    ratio = median(aer_s) / median(ours_s)
    whole = median(aer_s) / (median(ours_s) + median(diagonal_s))
    what = f"Aer's time over ours ({median(aer_s):.2f} s, {median(ours_s):.2f} s)"
    return [
        Check(what, f"{ratio:.1f}", f"≥ {_AIM:g}", ratio >= _AIM),
        Check("the same, diagonal included", f"{whole:.1f}", "–", None),
        Check(
            "mean energy of the shots, ours less Aer's",
            f"{off:+.4f}",
            f"0 ± {allowed:.4f}",
            abs(off) < allowed,
        ),
    ]


def _timed(do: Callable[[], T]) -> tuple[float, T]:
    began = time.perf_counter()
    found = do()
    return time.perf_counter() - began, found


def _energy(diagonal: Diagonal, states: Any, counts: Any) -> tuple[float, float]:
    """Mean energy of shots, and its standard error."""
    energies, shots = diagonal[states].astype(float), counts.sum()
    mean = float(counts @ energies / shots)
    return mean, float(np.sqrt(counts @ (energies - mean) ** 2) / shots)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; exit status 0 if the aim is reached and both agree."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.statevector", description=__doc__
    )
    parser.add_argument("--instance", default="arc25-01-avenue", metavar="NAME|FILE")
    parser.add_argument("--p", type=int, choices=range(1, 11), default=2, metavar="N")
    parser.add_argument("--shots", type=int, default=4096, metavar="N")
    parser.add_argument("--repeats", type=int, choices=range(1, 21), default=3, metavar="N")
    options = parser.parse_args(arguments)
    try:
        found = compare(options.instance, options.p, options.shots, options.repeats)
    except InputError as error:
        print(f"bench-statevector: {error}", file=sys.stderr)
        return 2
    print(f"{options.instance}, p = {options.p}, {options.shots} shots; {machine()}\n")
    print("\n".join(check_table(found)))
    return 1 if any(check.reached is False for check in found) else 0


if __name__ == "__main__":
    sys.exit(main())
