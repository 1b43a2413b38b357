"""Circuits on a linear chain: order of the qubits, exact matrix product states, training, and
placement on a device."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.chain.layout import QubitPlacement
from dispatcher_daemon.solvers.quantum.chain.order import heavy_path, path_weight
from dispatcher_daemon.solvers.quantum.chain.state import ChainState

__all__ = ["ChainState", "QubitPlacement", "heavy_path", "path_weight"]
