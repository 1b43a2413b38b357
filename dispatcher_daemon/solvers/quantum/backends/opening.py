"""Backends and job services by the names that settings and commands give them."""

from __future__ import annotations

from dispatcher_daemon.solvers.quantum.backends.aer import AerBackend, NoisyBackend, fake_target
from dispatcher_daemon.solvers.quantum.backends.base import Backend
from dispatcher_daemon.solvers.quantum.backends.jobs import JobService
from slipstream.errors import InputError


def open_backend(text: str) -> Backend:
    """The backend of that name.

    Args:
        text: "aer", "aer:FakeBoston" or another fake device (what may follow: `aer.ENDINGS`),
            "ibm:NAME" or "ibm:least-busy".

    Raises:
        InputError: there is no such backend, or no credentials for it.
        ServiceFault: IBM Quantum does not do what it is asked.
    """
    service, _, name = text.partition(":")
    if text == "aer":
        return AerBackend()
    if service == "aer" and name:
        device, plus, ending = name.partition("+")
        backend = NoisyBackend(device, plus + ending)
        fake_target(device)
        return backend
    if service == "ibm" and name:
        from dispatcher_daemon.solvers.quantum.backends.ibm import open_ibm_backend

        return open_ibm_backend(name)
    raise InputError(
        "backend",
        f"there is no backend {text!r}",
        "use aer, aer:FakeBoston, ibm:NAME or ibm:least-busy",
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
