"""QAOA simulated exactly: on all 2^n states, or on those with one option of each vehicle."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.statevector.diagonal import (
    MAX_QUBITS,
    Diagonal,
    cost_diagonal,
)
from dispatcher_daemon.solvers.quantum.statevector.exact_state import ExactState, Schedule
from dispatcher_daemon.solvers.quantum.statevector.transverse import StateVector

__all__ = [
    "MAX_QUBITS",
    "Diagonal",
    "ExactState",
    "Schedule",
    "StateVector",
    "cost_diagonal",
]
