"""Routing problems as models that solvers take: arc-form QUBO, linearised MILP."""

from __future__ import annotations

from dispatcher_daemon.forms.decode import decode, violations
from dispatcher_daemon.forms.enumerate import energies_of
from dispatcher_daemon.forms.model import build_model
from dispatcher_daemon.forms.qubo import Encoding, QuboModel

__all__ = [
    "Encoding",
    "QuboModel",
    "build_model",
    "decode",
    "energies_of",
    "violations",
]
