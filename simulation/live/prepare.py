"""From a scenario and a time of day to a world: background, RSUs, the orders of the hour."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from simulation.live.fleet_file import FleetFile
from simulation.live.world_spec import WorldSpec
from simulation.scenarios.demand import Deliveries, draw_deliveries
from simulation.scenarios.perception import Rsu
from simulation.scenarios.scenario import day_spec, load_scenario, own_background, prepare
from simulation.sumo import TYPES
from slipstream.config import BusSettings
from slipstream.errors import InputError

WARM_UP_S: Final = 300.0
"""Simulated before the world opens, so that the roads are not empty then."""


_RUN_S: Final = 10.0
"""Runs that begin within it get the same names; after 194 days names begin again."""


def prepare_world(
    name: str,
    folder: Path,
    bus: BusSettings,
    *,
    net: Path | None = None,
    demand: Path | None = None,
    routes: Path | None = None,
    rsus: Path | None = None,
    fleet: Path | None = None,
    begin_s: float,
    cameras: int,
    fps: float,
    priority: bool = False,
    seed: int,
) -> WorldSpec:
    """Load a scenario and write the files that its world needs into a folder.

    Args:
        name: of the scenario; ``net`` to ``fleet`` as for `load_scenario`.
        routes: a route file of the user's instead of any demand.
        begin_s: simulated time that the world opens at, s since midnight.
        cameras: RSUs that get one, the first ones of the scenario.
        fps: pictures a second.
        priority: whether vehicles may ask signals for green.
        seed: of traffic, orders and scenery.

    Raises:
        InputError: an unknown scenario, files that are malformed or do not fit each other, fewer
            RSUs than cameras, or no order at that time of day.
    """
    scenario = load_scenario(name, net=net, demand=demand, rsus=rsus, fleet=fleet)
    deliveries = named_anew(draw_deliveries(scenario.fleet, scenario.network, seed, name))
    folder.mkdir(parents=True, exist_ok=True)
    orders = folder / "fleet.json"
    if not FleetFile(orders, deliveries, begin_s).write(begin_s, ()):
        raise InputError("--begin", "no order is open at this time of day", "begin in the daytime")
    if scenario.rsus is not None:
        _check_count(name, scenario.rsus, cameras)
    background = (
        prepare(scenario, seed, folder) if routes is None else own_background(scenario, routes)
    )
    _check_count(name, background.rsus, cameras)
    day = day_spec(scenario, background, folder, begin_s=max(0.0, begin_s - WARM_UP_S))
    if routes is not None:
        types = folder / "fleet.add.xml"
        types.write_text(f"<additional>\n{TYPES['cav'].xml()}\n</additional>\n", encoding="utf-8")
        day = replace(day, additional=(*day.additional, types))
    return WorldSpec(
        day,
        begin_s,
        background.rsus[:cameras],
        deliveries,
        orders,
        bus,
        folder,
        priority=priority,
        seed=seed,
        fps=fps,
    )


def named_anew(deliveries: Deliveries) -> Deliveries:
    """The same orders under names that no run before had: what a database knows as served would
    not be planned again.
    """
    run = np.base_repr(int(time.time() / _RUN_S) % 36**4, 36).lower()
    orders = tuple(
        replace(order, id=f"{run}-{number}") for number, order in enumerate(deliveries.orders, 1)
    )
    return replace(deliveries, orders=orders)


def _check_count(name: str, rsus: Sequence[Rsu], cameras: int) -> None:
    if len(rsus) < cameras:
        raise InputError(
            name, f"{len(rsus)} RSUs for {cameras} cameras", "give --rsus or --rsu-file"
        )
