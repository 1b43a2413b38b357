"""Road networks of the scenarios: generated or from tables, converted to SUMO nets, and checked."""

from slipstream.osm.importing import Import, import_osm
from slipstream.osm.netconvert import build_net
from slipstream_lab.simulation.scenarios.networks.corridor import CorridorSettings, corridor_plan
from slipstream_lab.simulation.scenarios.networks.fixed_time import write_fixed_time
from slipstream_lab.simulation.scenarios.networks.network import (
    LeftOut,
    cut_network,
    largest_part,
    scenario_network,
)
from slipstream_lab.simulation.scenarios.networks.route_files import (
    check_additional,
    check_routes,
    count_passages,
    has_fleet_type,
)
from slipstream_lab.simulation.scenarios.networks.troy import troy_plan

__all__ = [
    "CorridorSettings",
    "Import",
    "LeftOut",
    "build_net",
    "check_additional",
    "check_routes",
    "corridor_plan",
    "count_passages",
    "cut_network",
    "has_fleet_type",
    "import_osm",
    "largest_part",
    "scenario_network",
    "troy_plan",
    "write_fixed_time",
]
