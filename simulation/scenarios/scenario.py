"""A scenario: a network, its demand, its RSUs and its fleet, by name or from files."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final, Literal

from simulation.scenarios.day import DaySpec
from simulation.scenarios.demand import (
    DemandSettings,
    DrawnBreakdown,
    FleetSettings,
    Flow,
    Routes,
    Trips,
    Zone,
    draw_breakdowns,
    draw_trips,
    find_routes,
    gateways,
    write_routes,
)
from simulation.scenarios.networks import check_routes, scenario_network, write_fixed_time
from simulation.scenarios.perception import Rsu, load_rsus, place_rsus
from slipstream.config import load
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.sumo_net import load_network

BUILT_IN: Final = ("troy", "corridor")

SignalControl = Literal["actuated", "fixed"]

_TRIPS_PER_KM: Final = 170
_ALL_DAY: Final = (
    *(0.5, 0.3, 0.2, 0.2, 0.4, 1.2, 3.0, 6.0, 6.0, 5.0, 5.0, 5.4),
    *(5.8, 5.6, 5.8, 6.6, 7.4, 7.2, 5.8, 4.4, 3.4, 2.6, 1.6, 0.8),
)


@dataclass(frozen=True)
class Scenario:
    """A world to evaluate in.

    Attributes:
        name: for people and files.
        net: the SUMO net.
        network: its roads, the largest connected part of them.
        demand: of the background.
        rsus: where they stand; None: on the busiest approaches of the day's background.
        fleet: what is delivered.
    """

    name: str
    net: Path
    network: RoadNetwork
    demand: DemandSettings
    rsus: tuple[Rsu, ...] | None
    fleet: FleetSettings


@dataclass(frozen=True)
class Background:
    """One day's background traffic, ready to be simulated.

    Attributes:
        file: SUMO's route file.
        rsus: the scenario's, or those that were placed by this traffic.
        trips: drawn from the seed; None where the file is the user's.
        routes: theirs.
        breakdowns: drawn from the seed.
    """

    file: Path
    rsus: tuple[Rsu, ...]
    trips: Trips | None = None
    routes: Routes | None = None
    breakdowns: tuple[DrawnBreakdown, ...] = ()


def load_scenario(
    name: str,
    *,
    net: Path | None = None,
    demand: Path | None = None,
    rsus: Path | None = None,
    fleet: Path | None = None,
) -> Scenario:
    """A built-in scenario, parts of it replaced, or one of the user's own around a net.

    With another net, what is not given is made up: trips between random places, RSUs on the
    busiest approaches, a fleet of delivery rounds from random depots.

    Raises:
        InputError: an unknown name without a net, or a file that is malformed or does not fit the
            net.
    """
    if net is None and name not in BUILT_IN:
        known = ", ".join(BUILT_IN)
        raise InputError(name, "no such scenario", f"give a net, or built in: {known}")
    own = net is not None
    folder = Path(str(resources.files("simulation.scenarios") / "data" / name))
    net = net or folder / f"{name}.net.xml.gz"
    network = scenario_network(net)
    demand = demand or (None if own else folder / "demand.toml")
    rsus = rsus or (None if own else folder / "rsus.toml")
    fleet = fleet or (None if own else folder / "fleet.toml")
    return Scenario(
        name,
        net,
        network,
        default_demand(network) if demand is None else load(demand, DemandSettings),
        None if rsus is None else load_rsus(rsus, network),
        FleetSettings() if fleet is None else load(fleet, FleetSettings),
    )


def prepare(scenario: Scenario, seed: int, folder: Path) -> Background:
    """Draw a day's background and write its route file.

    Args:
        seed: the same one gives the same file, byte for byte.
        folder: made if it does not exist.

    Raises:
        InputError: the demand does not fit the network.
    """
    source = f"{scenario.name}: demand"
    trips = draw_trips(scenario.demand, scenario.network, seed, source)
    breakdowns = draw_breakdowns(scenario.demand.breakdowns, scenario.network, seed, source)
    routes = find_routes(trips, scenario.network, seed)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{scenario.name}-{seed}.rou.xml"
    write_routes(file, trips, routes, scenario.network, breakdowns)
    rsus = scenario.rsus
    if rsus is None:
        rsus = place_rsus(scenario.network, routes.passages())
    return Background(file, rsus, trips, routes, breakdowns)


def own_background(scenario: Scenario, routes: Path) -> Background:
    """The user's own route file as the background; RSUs stand only where the scenario has them.

    Raises:
        InputError: the file is no route file, or one of another net.
    """
    check_routes(routes, load_network(scenario.net).segments)
    return Background(routes, scenario.rsus or ())


def day_spec(
    scenario: Scenario,
    background: Background,
    folder: Path,
    *,
    signals: SignalControl = "actuated",
    begin_s: float = 0.0,
    end_s: float = 86400.0,
) -> DaySpec:
    """What `simulation.scenarios.day.run_day` needs for a day of a scenario.

    Raises:
        InputError: fixed-time signals of a net that has none.
    """
    additional: tuple[Path, ...] = ()
    if signals == "fixed":
        path = folder / f"{scenario.name}-fixed.add.xml"
        write_fixed_time(scenario.net, path)
        additional = (path,)
    return DaySpec(
        scenario.net,
        background.file,
        tuple(scenario.network.segments),
        additional,
        background.rsus,
        begin_s=begin_s,
        end_s=end_s,
    )


def default_demand(network: RoadNetwork) -> DemandSettings:
    """Light demand for a net of which nothing is known: random pairs of places, a day's curve."""
    km = sum(segment.length_m for segment in network.segments.values()) / 1000
    ends = dict.fromkeys(sorted(gateways(network)), 1.0)
    return DemandSettings(
        zones={"anywhere": Zone(base=1.0, junctions=ends)},
        flows=(
            Flow(
                name="any",
                trips=max(500, round(_TRIPS_PER_KM * km)),
                origin="anywhere",
                destination="anywhere",
                hours=_ALL_DAY,
            ),
        ),
        types={"car": 0.9, "van": 0.06, "truck": 0.04},
    )
