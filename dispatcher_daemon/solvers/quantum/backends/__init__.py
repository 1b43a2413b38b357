"""Places that run circuits: Aer, and devices of IBM Quantum."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.backends.aer import (
    DECOUPLED,
    IDLE,
    TWIRLED,
    NoisyBackend,
    fake_target,
)
from dispatcher_daemon.solvers.quantum.backends.base import Backend, Sampled
from dispatcher_daemon.solvers.quantum.backends.ibm_account import find_access
from dispatcher_daemon.solvers.quantum.backends.jobs import (
    FaultKind,
    JobService,
    JobView,
    ServiceFault,
)
from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise, blocks_of
from dispatcher_daemon.solvers.quantum.backends.opening import open_backend, open_service
from dispatcher_daemon.solvers.quantum.backends.targets import (
    Depths,
    compare_depths,
    transpile_dense,
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)

__all__ = [
    "DECOUPLED",
    "IDLE",
    "TWIRLED",
    "Backend",
    "Depths",
    "DeviceNoise",
    "FaultKind",
    "JobService",
    "JobView",
    "NoisyBackend",
    "Sampled",
    "ServiceFault",
    "blocks_of",
    "compare_depths",
    "fake_target",
    "find_access",
    "open_backend",
    "open_service",
    "transpile_dense",
    "transpile_on",
    "two_qubit_depth",
    "two_qubit_gates",
]
