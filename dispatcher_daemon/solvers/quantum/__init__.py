"""Quantum circuits of QUBOs: ansätze, classical training, and backends."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.circuits import (
    chain_circuit,
)
from dispatcher_daemon.solvers.quantum.ising import Ising, to_ising
from dispatcher_daemon.solvers.quantum.lc_qaoa import (
    RESTARTS,
    LcQaoaSolver,
    Prepared,
    prepare_model,
)
from dispatcher_daemon.solvers.quantum.qaoa import QaoaSolver, ramp_of

__all__ = [
    "RESTARTS",
    "ChainAnsatz",
    "Ising",
    "LcQaoaSolver",
    "Prepared",
    "QaoaSolver",
    "chain_circuit",
    "linear_ramp",
    "prepare_model",
    "ramp_of",
    "scheduled",
    "to_ising",
]
