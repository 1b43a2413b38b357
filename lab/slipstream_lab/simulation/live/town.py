"""The built-in town: a dozen vans that deliver around the clock, for `slipstream run`."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Final

from dispatcher_daemon.fleet import Depot
from slipstream.config import BusSettings
from slipstream.roads.sumo_net import DEMO_NETWORK, load_network
from slipstream_lab.simulation.live.fleet_file import LiveFleetFile
from slipstream_lab.simulation.live.prepare import named_anew
from slipstream_lab.simulation.live.world_spec import WorldSpec
from slipstream_lab.simulation.scenarios.day import DaySpec
from slipstream_lab.simulation.scenarios.demand import FleetSettings, Zone, draw_deliveries
from slipstream_lab.simulation.sumo import TYPES

DEPOT: Final = "depot"
VANS: Final = 12
_EVEN: Final = (1.0,) * 24
_FLEET: Final = FleetSettings(
    depots=(Depot(id=DEPOT, node=DEPOT),),
    vehicles=VANS,
    capacity=4,
    # Twelve vans on rounds of some ten minutes: as many orders as they can serve.
    orders=4300,
    # Most customers live beyond the avenue.
    stops=Zone(junctions={"c1": 3.0, "c3": 3.0, "avenue_e": 2.0, "c2": 1.0, "c4": 1.0}),
    parcels=(1, 2),
    hours=_EVEN,
    # A lorry brings most parcels at once, as to most depots: vans leave together.
    wave_s=600.0,
    wave_due_s=(1800.0, 3600.0),
    express_due_s=(1800.0, 3600.0),
    service_s=(15.0, 40.0),
    depart_within_s=120.0,
    last_release_s=86400.0,
)
_FULL_S: Final = 560.0
"""The town begins at this time of its day, with the orders of the time before it open: shortly
before its first wave, which finds cameras that have seen the avenue."""


def town(folder: Path, bus: BusSettings, seed: int = 1, vans: int = VANS) -> WorldSpec:
    """Write the files of the town into a folder; with fewer vans it has fewer orders."""
    folder.mkdir(parents=True, exist_ok=True)
    network = load_network(DEMO_NETWORK)
    fleet = _FLEET.model_copy(update={"vehicles": vans, "orders": _FLEET.orders * vans // VANS})
    deliveries = named_anew(draw_deliveries(fleet, network, seed, "town"))
    types = folder / "town.rou.xml"
    types.write_text(f"<routes>\n{TYPES['cav'].xml()}\n</routes>\n", encoding="utf-8")
    orders = folder / "fleet.json"
    LiveFleetFile(orders, deliveries, _FULL_S).write(_FULL_S, ())
    with resources.as_file(resources.files("slipstream") / "data" / "demo.net.xml") as net:
        day = DaySpec(net, (types,), tuple(network.segments), begin_s=_FULL_S)
    return WorldSpec(day, _FULL_S, (), deliveries, orders, bus, folder)
