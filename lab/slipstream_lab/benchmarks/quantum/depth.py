"""Two-qubit depth of LC-QAOA and of dense QAOA on one target: `python -m
slipstream_lab.benchmarks.quantum.depth`.

The dense circuit is transpiled by the better of two methods, routed by the transpiler's highest
level and as a swap network on the best chain. Targets: the fake device's CZ, and the same with
native RZZ (snapshots of devices list none: an assumption, see `targets.with_fractional_gates`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from dispatcher_daemon.solvers.quantum import (
    Ising,
    chain_circuit,
    linear_ramp,
    scheduled,
    to_ising,
)
from dispatcher_daemon.solvers.quantum.backends import (
    open_backend,
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.chain import heavy_path, place_chain
from slipstream_lab.benchmarks.aims import Check, check_table
from slipstream_lab.research.quantum.case import named_cases, open_case
from slipstream_lab.research.quantum.dense import dense_candidates

PAPER_REDUCTION: Final = 0.667
_DEVICE: Final = "aer:FakeBoston"


@dataclass(frozen=True)
class Depths:
    """What one instance's circuits need on a target, transpiled in one run.

    Attributes:
        chain_depth: two-qubit depth of LC-QAOA.
        chain_gates: its two-qubit gates.
        dense_depth: two-qubit depth of QAOA with all couplings, by the better method.
        dense_gates: two-qubit gates of that circuit.
        dense_method: "routed" by the transpiler, or "swap network" on the best chain.
    """

    chain_depth: int
    chain_gates: int
    dense_depth: int
    dense_gates: int
    dense_method: str

    @property
    def reduction(self) -> float:
        """Share of the dense circuit's depth that the chain saves."""
        return 1 - self.chain_depth / self.dense_depth


def compare_depths(ising: Ising, schedule: Sequence[tuple[float, float]], target: Any) -> Depths:
    """LC-QAOA beside dense QAOA on one target; ``ising`` is in chain order, normalised."""
    qubits = place_chain(target, len(ising.h), len(schedule)).qubits
    chain = transpile_on(chain_circuit(scheduled(ising, schedule)), target, qubits)
    candidates = dense_candidates(ising, schedule, target, qubits)
    method, dense = min(candidates.items(), key=lambda item: two_qubit_depth(item[1]))
    return Depths(
        chain_depth=two_qubit_depth(chain),
        chain_gates=two_qubit_gates(chain),
        dense_depth=two_qubit_depth(dense),
        dense_gates=two_qubit_gates(dense),
        dense_method=method,
    )


@dataclass(frozen=True)
class DepthRow:
    """One depth on one target.

    Attributes:
        p: layers.
        gate: the target's two-qubit gate for a ZZ rotation.
        allowed: depth that is aimed at, at most.
        depths: by instance.
    """

    p: int
    gate: str
    allowed: int
    depths: tuple[Depths, ...]

    @property
    def worst_depth(self) -> int:
        """Greatest depth of the chain."""
        return max(d.chain_depth for d in self.depths)

    @property
    def least_reduction(self) -> float:
        """Least share of the dense circuit's depth that the chain saves."""
        return min(d.reduction for d in self.depths)


def measure(instances: int, layers: Sequence[int]) -> list[DepthRow]:
    """All depths, on the first so many named instances."""
    isings = []
    for name in named_cases(instances):
        model = open_case(name).model
        ising = to_ising(model.total, model.variables)
        isings.append(ising.permuted(heavy_path(ising.coupling)).normalised())
    rows = []
    for gate, backend, per_layer in (("CZ", _DEVICE, 4), ("RZZ", f"{_DEVICE}+fractional", 2)):
        target = open_backend(backend).target
        for p in layers:
            found = tuple(compare_depths(i, linear_ramp(p, 0.3, 0.6), target) for i in isings)
            rows.append(DepthRow(p, gate, per_layer * p, found))
    return rows


def checks(rows: Sequence[DepthRow]) -> list[Check]:
    """The aims."""
    found = []
    for row in rows:
        depth, saved = row.worst_depth, row.least_reduction
        dense = sorted(d.dense_depth for d in row.depths)
        found += [
            Check(
                f"two-qubit depth of LC-QAOA, p = {row.p}, {row.gate} (the paper: {28 * row.p})",
                str(depth),
                f"≤ {row.allowed}",
                depth <= row.allowed,
            ),
            Check(
                f"below dense QAOA (depth {dense[0]} to {dense[-1]}), p = {row.p}, {row.gate}",
                f"{100 * saved:.1f} %",
                "≥ 66.7 %",
                saved >= PAPER_REDUCTION,
            ),
        ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; exit status 0 if all aims are reached."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.quantum.depth", description=__doc__
    )
    parser.add_argument("--instances", type=int, choices=range(1, 21), default=20, metavar="N")
    parser.add_argument("--layers", type=int, nargs="+", default=[1, 2, 3], metavar="P")
    options = parser.parse_args(arguments)
    rows = measure(options.instances, options.layers)
    found_checks = checks(rows)
    print("\n".join(check_table(found_checks)))
    return 0 if all(check.reached for check in found_checks) else 1


if __name__ == "__main__":
    sys.exit(main())
