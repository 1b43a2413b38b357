"""Back ends by the names that `slipstream solve` and `bench` take; Aer where a device fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from dispatcher_daemon.solvers import BackendKind
from dispatcher_daemon.solvers.quantum import backends
from dispatcher_daemon.solvers.quantum.backends import Backend, Sampled, ServiceFault
from dispatcher_daemon.solvers.quantum.chain import QubitPlacement

FALLBACK = "aer"


def open_backend(text: str) -> Backend:
    """The backend of that name.

    Args:
        text: "aer", "aer:FakeBoston" or another fake device and what may follow it
            ("+fractional", `idle.IDLE_ENDINGS`), "ibm:NAME" or "ibm:least-busy".

    Raises:
        InputError: there is no such backend, or no credentials for it.
        ServiceFault: IBM Quantum does not do what it is asked.
    """
    service, _, name = text.partition(":")
    if service == "aer" and "+" in name.removesuffix("+fractional"):
        from slipstream_lab.research.quantum.backends.idle import open_idle

        return open_idle(name)
    if service == "ibm" and name:
        from slipstream_lab.research.quantum.backends.ibm import open_ibm_backend

        return open_ibm_backend(name)
    return backends.open_backend(text)


def open_or_fall_back(text: str) -> Backend:
    """The backend of that name; Aer where a device is out of reach, fails or is late.

    Raises:
        InputError: there is no such backend, or no credentials for it.
    """
    try:
        opened = open_backend(text)
    except ServiceFault as fault:
        return WithFallback(backends.open_backend(FALLBACK), f"{text}: {fault}")
    return WithFallback(opened) if opened.kind == "hardware" else opened


@dataclass(frozen=True)
class WithFallback:
    """A device, replaced by Aer where it fails; samples say which of them they are from.

    Attributes:
        backend: the device, or Aer in its place.
        fallback: why it is Aer; None: it is the device.
    """

    backend: Backend
    fallback: str | None = None

    @property
    def name(self) -> str:
        """See `Backend.name`."""
        return self.backend.name

    @property
    def kind(self) -> BackendKind:
        """See `Backend.kind`."""
        return self.backend.kind

    @property
    def target(self) -> Any:
        """See `Backend.target`."""
        return self.backend.target

    def place(self, n: int, bond_weights: Sequence[float] | None = None) -> QubitPlacement:
        """See `Backend.place`."""
        return self.backend.place(n, bond_weights)

    def sample(self, circuit: Any, shots: int, seed: int, wait_s: float = 900.0) -> Sampled:
        """See `Backend.sample`."""
        try:
            found, why = self.backend.sample(circuit, shots, seed, wait_s), self.fallback
        except ServiceFault as fault:
            found = backends.open_backend(FALLBACK).sample(circuit, shots, seed)
            why = f"{self.name}: {fault}"
        return replace(found, fallback=why)
