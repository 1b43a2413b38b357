"""Simulation of an evaluation's arms, and their storage with everything that results depend on."""

from slipstream_lab.simulation.evaluation.runs.provenance import Provenance, code_stamp
from slipstream_lab.simulation.evaluation.runs.run import Simulate, run_missing
from slipstream_lab.simulation.evaluation.runs.store import (
    ArmStore,
    StoredArm,
    not_writable,
    write_atomically,
)
from slipstream_lab.simulation.evaluation.runs.world import World, WorldFiles

__all__ = [
    "ArmStore",
    "Provenance",
    "Simulate",
    "StoredArm",
    "World",
    "WorldFiles",
    "code_stamp",
    "not_writable",
    "run_missing",
    "write_atomically",
]
