"""Circuits on a linear chain: order of the qubits, exact matrix product states, training, and
placement on a device."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement, place_chain
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path, path_weight
from dispatcher_daemon.solvers.quantum.chain.sites import Ansatz
from dispatcher_daemon.solvers.quantum.chain.state import ChainState
from dispatcher_daemon.solvers.quantum.chain.training import mean_energy, train_schedule

__all__ = [
    "Ansatz",
    "ChainState",
    "QubitPlacement",
    "heavy_path",
    "mean_energy",
    "path_weight",
    "place_chain",
    "train_schedule",
]
