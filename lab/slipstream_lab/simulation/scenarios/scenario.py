"""A scenario: a network, its demand, its RSUs and its fleet, by name or from files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final, Literal

from slipstream.config import load
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from slipstream.vehicle_types import PresetName
from slipstream_lab.simulation.rsus import Rsu, load_rsus
from slipstream_lab.simulation.scenarios.day import DaySpec
from slipstream_lab.simulation.scenarios.defaults import (
    KEEP_S,
    KM_PER_RSU,
    TRIPS_PER_KM,
    default_demand,
    default_fleet,
    road_km,
    rsu_count,
)
from slipstream_lab.simulation.scenarios.demand import (
    DemandSettings,
    DrawnBreakdown,
    FleetSettings,
    Routes,
    Trips,
    draw_breakdowns,
    draw_deliveries,
    draw_trips,
    find_routes,
    write_routes,
)
from slipstream_lab.simulation.scenarios.networks import (
    LeftOut,
    check_additional,
    check_routes,
    count_passages,
    cut_network,
    has_fleet_type,
    write_fixed_time,
)
from slipstream_lab.simulation.scenarios.perception import place_rsus
from slipstream_lab.simulation.sumo import TYPES, put_file, without_output

BUILT_IN: Final = ("troy", "corridor")

SignalControl = Literal["actuated", "fixed"]


@dataclass(frozen=True)
class Scenario:
    """A world to evaluate in.

    Attributes:
        rsus: where they stand; None: on the busiest approaches of the day's background.
        left_out: what of the net is not in the network; None: nothing.
        made_up: which of "demand" and "fleet" nobody gave.
    """

    name: str
    net: Path
    network: RoadNetwork
    demand: DemandSettings
    rsus: tuple[Rsu, ...] | None
    fleet: FleetSettings
    routes: tuple[Path, ...] = ()
    additional: tuple[Path, ...] = ()
    left_out: LeftOut | None = None
    made_up: frozenset[str] = frozenset()


@dataclass(frozen=True)
class BackgroundTraffic:
    """One day's background traffic, ready to be simulated.

    Attributes:
        rsus: the scenario's, or those that were placed by this traffic.
        trips: drawn from the seed; None where the files are the user's.
    """

    files: tuple[Path, ...]
    rsus: tuple[Rsu, ...]
    trips: Trips | None = None
    routes: Routes | None = None
    breakdowns: tuple[DrawnBreakdown, ...] = ()
    additional: tuple[Path, ...] = ()


def load_scenario(
    name: str,
    *,
    net: Path | None = None,
    demand: Path | None = None,
    rsus: Path | None = None,
    fleet: Path | None = None,
    type: PresetName | None = None,
    routes: Sequence[Path] = (),
    additional: Sequence[Path] = (),
    own_routes: bool = False,
) -> Scenario:
    """A built-in scenario, parts of it replaced, or one of the user's own around a net.

    With another net, what is not given is made up and sized for it: trips between random places,
    RSUs on the busiest approaches, a fleet of delivery rounds from random depots. Around routes of
    the user's, which may last for an hour at any time, orders come evenly, some in each five
    minutes.

    Args:
        type: of the fleet's vehicles; None: the fleet's own.
        own_routes: whether there are routes of the user's, where they are not given here.

    Raises:
        InputError: an unknown name without a net, or a file that is malformed or does not fit the
            net.
    """
    if net is None and name not in BUILT_IN:
        known = ", ".join(BUILT_IN)
        raise InputError(name, "no such scenario", f"give a net, or built in: {known}")
    own = net is not None
    folder = _folder(name)
    net = net or folder / f"{name}.net.xml.gz"
    network, left_out = cut_network(net)
    if routes:
        check_routes(routes, load_network(net).segments)
    check_additional(additional)
    demand = demand or (None if own else folder / "demand.toml")
    rsus = rsus or (None if own else folder / "rsus.toml")
    routed = own_routes or bool(routes)
    deliveries = fleet_settings(name, fleet, own_net=own, own_routes=routed)
    if type is not None:
        deliveries = deliveries.model_copy(update={"type": type})
    given = {"demand": demand or routed or None, "fleet": fleet}
    made_up = frozenset(part for part, of in given.items() if own and of is None)
    return Scenario(
        name,
        net,
        network,
        default_demand(network) if demand is None else load(demand, DemandSettings),
        None if rsus is None else load_rsus(rsus, network),
        default_fleet(network, deliveries) if "fleet" in made_up else deliveries,
        tuple(routes),
        tuple(additional),
        left_out,
        made_up,
    )


def made_up(scenario: Scenario, background: BackgroundTraffic, seed: int) -> tuple[str, ...]:
    """What nobody gave and the net and a seed's background stand for, a line each."""
    lines, fleet = [], scenario.fleet
    km = road_km(scenario.network)
    if "demand" in scenario.made_up:
        lines.append(
            f"demand: {scenario.demand.flows[0].trips:,} trips a day between random places, "
            f"{TRIPS_PER_KM} for each of {km:.0f} km of road, at least "
            f"{scenario.demand.min_trip_m:g} m; {', '.join(scenario.demand.types)}"
        )
    if scenario.rsus is None:
        at = [stretch.segment for rsu in background.rsus for stretch in rsu.watch]
        lines.append(
            f"RSUs: {len(at)} on the busiest approaches, of {rsu_count(scenario.network)} (one "
            f"for each {KM_PER_RSU:g} km of road, 12 at least), each flag kept for {KEEP_S:g} s "
            f"where traffic is thin, seed {seed}: "
            f"{', '.join(at) or 'no segment is long enough, so no platoon will drive'}"
        )
    if "fleet" in scenario.made_up:
        early, late = (round(time_s / 60) for time_s in fleet.wave_due_s)
        lines.append(
            f"fleet: {fleet.orders:,} orders a day, {fleet.vehicles} vehicles for "
            f"{fleet.capacity} parcels each, due {early} to {late} min after each wave"
        )
    if not fleet.depots:
        drawn = draw_deliveries(fleet, scenario.network, seed).settings.depots
        lines.append(f"depots, seed {seed}: {', '.join(depot.node for depot in drawn)}")
    return tuple(lines)


def prepare(scenario: Scenario, seed: int, folder: Path) -> BackgroundTraffic:
    """Draw a day's background and write its route file, or take the user's own.

    Args:
        seed: the same one gives the same file, byte for byte; the user's own is the same in all.

    Raises:
        InputError: the demand does not fit the network.
    """
    folder.mkdir(parents=True, exist_ok=True)
    additional = without_output(scenario.additional, folder)
    rsus = scenario.rsus
    if scenario.routes:
        if not has_fleet_type((*scenario.routes, *scenario.additional)):
            types = folder / "fleet.add.xml"
            text = f"<additional>\n{TYPES['cav'].xml()}\n</additional>\n"
            put_file(types, text)
            additional = (*additional, types)
        if rsus is None:
            passages = count_passages(scenario.routes, scenario.network)
            rsus = _placed(scenario.network, passages)
        return BackgroundTraffic(scenario.routes, rsus, additional=additional)
    source = f"{scenario.name}: demand"
    trips = draw_trips(scenario.demand, scenario.network, seed, source)
    breakdowns = draw_breakdowns(scenario.demand.breakdowns, scenario.network, seed, source)
    routes = find_routes(trips, scenario.network, seed)
    file = folder / f"{scenario.name}-{seed}.rou.xml"
    write_routes(file, trips, routes, scenario.network, breakdowns)
    if rsus is None:
        rsus = _placed(scenario.network, routes.passages())
    return BackgroundTraffic((file,), rsus, trips, routes, breakdowns, additional)


def _placed(network: RoadNetwork, passages: Mapping[str, int]) -> tuple[Rsu, ...]:
    return place_rsus(network, passages, rsu_count(network), keep_s=KEEP_S)


def day_spec(
    scenario: Scenario,
    background: BackgroundTraffic,
    folder: Path,
    *,
    signals: SignalControl = "actuated",
    begin_s: float = 0.0,
    end_s: float = 86400.0,
) -> DaySpec:
    """What `slipstream_lab.simulation.scenarios.day.run_day` needs for a day of a scenario."""
    additional = background.additional
    if signals == "fixed":
        path = folder / f"{scenario.name}-fixed.add.xml"
        write_fixed_time(scenario.net, path)
        additional = (*additional, path)  # SUMO runs the program that it has read last
    return DaySpec(
        scenario.net,
        background.files,
        tuple(scenario.network.segments),
        additional,
        background.rsus,
        begin_s=begin_s,
        end_s=end_s,
    )


def fleet_settings(
    name: str, file: Path | None, *, own_net: bool, own_routes: bool
) -> FleetSettings:
    """The fleet of `load_scenario`: a file's, a built-in scenario's, or one that is made up.
    Raises InputError: the file is missing or faulty.
    """
    if file is None and not own_net:
        file = _folder(name) / "fleet.toml"
    if file is not None:
        return load(file, FleetSettings)
    if own_routes:
        return FleetSettings(hours=(1.0,) * 24, orders=1200, wave_s=300.0)
    return FleetSettings()


def _folder(name: str) -> Path:
    return Path(str(resources.files("slipstream_lab.simulation.scenarios") / "data" / name))
