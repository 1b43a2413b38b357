"""Quantum circuits of QUBOs: ansätze, classical training, and backends."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.ansatz import ChainAnsatz, linear_ramp, scheduled
from dispatcher_daemon.solvers.quantum.circuits import (
    chain_circuit,
    dense_qaoa_circuit,
    swap_network_circuit,
)
from dispatcher_daemon.solvers.quantum.ising import Ising, to_ising
from dispatcher_daemon.solvers.quantum.iskay import IskaySolver
from dispatcher_daemon.solvers.quantum.lc_qaoa import LcQaoaSolver, Prepared, prepare_model
from dispatcher_daemon.solvers.quantum.qaoa import ramp_of

__all__ = [
    "ChainAnsatz",
    "Ising",
    "IskaySolver",
    "LcQaoaSolver",
    "Prepared",
    "chain_circuit",
    "dense_qaoa_circuit",
    "linear_ramp",
    "prepare_model",
    "ramp_of",
    "scheduled",
    "swap_network_circuit",
    "to_ising",
]
