"""A device with Aer as fallback, for callers that wait for one answer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from dispatcher_daemon.solvers.quantum.backends.base import Backend, Sampled
from dispatcher_daemon.solvers.quantum.backends.jobs import ServiceFault
from dispatcher_daemon.solvers.quantum.backends.opening import open_backend

FALLBACK = "aer"


@dataclass(frozen=True)
class Opened:
    """A backend, and why it is not the requested one.

    Attributes:
        fallback: None if it is.
    """

    backend: Backend
    fallback: str | None = None

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float) -> tuple[Opened, Sampled]:
        """Samples, and where they came from; see `Backend.sample`.

        Args:
            wait_s: for a device, s; its job is cancelled after that.
        """
        backend = self.backend
        if backend.kind != "hardware":
            return self, backend.sample(circuit, shots, seed)
        from dispatcher_daemon.solvers.quantum.backends.ibm import IbmBackend

        if isinstance(backend, IbmBackend):
            backend = replace(backend, wait_s=wait_s)
        try:
            return self, backend.sample(circuit, shots, seed)
        except ServiceFault as fault:
            other = Opened(open_backend(FALLBACK), f"{backend.name}: {fault}")
            return other, other.backend.sample(circuit, shots, seed)


def open_or_fall_back(text: str) -> Opened:
    """The backend of that name (see `open_backend`), or Aer where a device is out of reach.

    Raises:
        InputError: there is no such backend, or no credentials for it.
    """
    try:
        return Opened(open_backend(text))
    except ServiceFault as fault:
        return Opened(open_backend(FALLBACK), f"{text}: {fault}")
