"""LC-QAOA's circuits without Qiskit, for a service that only needs their width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dispatcher_daemon.solvers.quantum.hardware import ChainCircuitBuilder


@dataclass(frozen=True)
class AnsatzBuilder(ChainCircuitBuilder):
    """Circuits as tables of angles, enough for the simulated service and without Qiskit."""

    def warm_up(self) -> None:
        """Nothing beyond what unpickling this imports."""

    def circuit(self, ansatz: Any) -> Any:
        """As it is."""
        return ansatz
