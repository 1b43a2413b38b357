"""Places that run circuits: Aer, and devices of IBM Quantum."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.backends.aer import NoisyBackend, fake_target, sampled
from dispatcher_daemon.solvers.quantum.backends.base import Backend, Sampled, fit
from dispatcher_daemon.solvers.quantum.backends.ibm import IbmService, open_ibm
from dispatcher_daemon.solvers.quantum.backends.ibm_account import AccountAccess, find_access
from dispatcher_daemon.solvers.quantum.backends.jobs import (
    FaultKind,
    JobService,
    JobView,
    ServiceFault,
)
from dispatcher_daemon.solvers.quantum.backends.noise import DeviceNoise, blocks_of
from dispatcher_daemon.solvers.quantum.backends.opening import open_backend, open_service
from dispatcher_daemon.solvers.quantum.backends.targets import (
    transpile_on,
    two_qubit_depth,
    two_qubit_gates,
)
from dispatcher_daemon.solvers.quantum.backends.trajectories import sample_noisy

__all__ = [
    "AccountAccess",
    "Backend",
    "DeviceNoise",
    "FaultKind",
    "IbmService",
    "JobService",
    "JobView",
    "NoisyBackend",
    "Sampled",
    "ServiceFault",
    "blocks_of",
    "fake_target",
    "find_access",
    "fit",
    "open_backend",
    "open_ibm",
    "open_service",
    "sample_noisy",
    "sampled",
    "transpile_on",
    "two_qubit_depth",
    "two_qubit_gates",
]
