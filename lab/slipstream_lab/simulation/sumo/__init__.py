"""Running SUMO: a session in this process or in a subprocess, its input files, its vehicle types.

`session` needs libsumo and is not exported here; who simulates in its own process imports it.
"""

from slipstream.roads.sumo_files import elements
from slipstream_lab.simulation.sumo.additional import without_output
from slipstream_lab.simulation.sumo.config import SumoFiles, read_configuration
from slipstream_lab.simulation.sumo.files import (
    check_files,
    check_no_include,
    check_vehicle_files,
    put_file,
)
from slipstream_lab.simulation.sumo.subprocess import Progress, run_in_subprocess
from slipstream_lab.simulation.sumo.vehicle_types import FLEET_PREFIX, FLEET_TYPES, TYPES

__all__ = [
    "FLEET_PREFIX",
    "FLEET_TYPES",
    "TYPES",
    "Progress",
    "SumoFiles",
    "check_files",
    "check_no_include",
    "check_vehicle_files",
    "elements",
    "put_file",
    "read_configuration",
    "run_in_subprocess",
    "without_output",
]
