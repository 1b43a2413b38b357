"""Road networks of the scenarios: generated or from tables, converted to SUMO nets, and checked."""

from simulation.scenarios.networks.corridor import CorridorSettings, corridor_plan
from simulation.scenarios.networks.fixed_time import write_fixed_time
from simulation.scenarios.networks.netconvert import build_net, convert_osm
from simulation.scenarios.networks.network import check_routes, largest_part, scenario_network
from simulation.scenarios.networks.troy import troy_plan

__all__ = [
    "CorridorSettings",
    "build_net",
    "check_routes",
    "convert_osm",
    "corridor_plan",
    "largest_part",
    "scenario_network",
    "troy_plan",
    "write_fixed_time",
]
