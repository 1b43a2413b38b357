"""Backends and job services by the names that settings and commands give them."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.backends.aer import (
    FRACTIONAL,
    AerBackend,
    NoisyBackend,
    fake_target,
)
from dispatcher_daemon.solvers.quantum.backends.base import Backend
from dispatcher_daemon.solvers.quantum.backends.jobs import JobService
from slipstream.errors import InputError


def open_backend(text: str) -> Backend:
    """The simulator of that name.

    Args:
        text: "aer", "aer:FakeBoston" or another fake device, "aer:FakeBoston+fractional".

    Raises:
        InputError: there is no such simulator.
    """
    service, _, name = text.partition(":")
    if text == "aer":
        return AerBackend()
    device = name.removesuffix(FRACTIONAL)
    if service == "aer" and device:
        fake_target(device)
        return NoisyBackend(device, fractional=device != name)
    raise InputError(
        "backend",
        f"there is no backend {text!r}",
        "use aer, aer:FakeBoston or aer:FakeBoston+fractional",
    )


def open_service(text: str) -> JobService:
    """The job service of that name.

    Args:
        text: "ibm:NAME", "ibm:least-busy", or "fake:FakeBoston" or another fake device: its noise
            model behind the same calls.

    Raises:
        InputError: there is no such service, or no credentials for it.
        ServiceFault: IBM Quantum does not do what it is asked.
    """
    service, _, name = text.partition(":")
    if service == "fake" and name:
        from dispatcher_daemon.solvers.quantum.backends.local import LocalService

        return LocalService(name)
    if service == "ibm" and name:
        from dispatcher_daemon.solvers.quantum.backends.ibm import open_ibm

        return open_ibm(name)
    raise InputError(
        "backend",
        f"there is no job service {text!r}",
        "use ibm:NAME, ibm:least-busy or fake:FakeBoston",
    )
