"""Running SUMO: a session in this process or in a subprocess, its input files, its vehicle types.

`session` needs libsumo and is not exported here; who simulates in its own process imports it.
"""

from simulation.sumo.files import check_files, check_vehicle_files, elements
from simulation.sumo.subprocess import Progress, run_in_subprocess
from simulation.sumo.vehicle_types import TYPES

__all__ = [
    "TYPES",
    "Progress",
    "check_files",
    "check_vehicle_files",
    "elements",
    "run_in_subprocess",
]
