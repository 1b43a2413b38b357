"""From a scenario and a time of day to a world: background, RSUs, the orders of the hour."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from slipstream.config import BusSettings
from slipstream.errors import InputError
from slipstream_lab.simulation.live.fleet_file import LiveFleetFile
from slipstream_lab.simulation.live.world_spec import WorldSpec
from slipstream_lab.simulation.rsus import Rsu
from slipstream_lab.simulation.scenarios.acceptance import clock
from slipstream_lab.simulation.scenarios.demand import Deliveries, draw_deliveries
from slipstream_lab.simulation.scenarios.scenario import (
    day_spec,
    load_scenario,
    made_up,
    prepare,
)

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
    routes: Sequence[Path] = (),
    additional: Sequence[Path] = (),
    rsus: Path | None = None,
    fleet: Path | None = None,
    from_s: float = 0.0,
    begin_s: float,
    cameras: int,
    fps: float,
    priority: bool = False,
    seed: int,
    say: Callable[[str], None] = lambda _: None,
) -> WorldSpec:
    """Load a scenario and write the files that its world needs into a folder.

    Args:
        name: of the scenario; ``net`` to ``fleet`` as for `load_scenario`.
        additional: SUMO additional files of the user's.

    Raises:
        InputError: an unknown scenario, files that are malformed or do not fit each other, fewer
            RSUs than cameras, or no order at that time of day.
    """
    scenario = load_scenario(
        name,
        net=net,
        demand=demand,
        rsus=rsus,
        fleet=fleet,
        routes=routes,
        additional=additional,
    )
    deliveries = named_anew(draw_deliveries(scenario.fleet, scenario.network, seed, name))
    folder.mkdir(parents=True, exist_ok=True)
    orders = folder / "fleet.json"
    if not LiveFleetFile(orders, deliveries, begin_s).write(begin_s, ()):
        later = min((o.release_s for o in deliveries.orders if o.release_s > begin_s), default=None)
        mend = "begin earlier" if later is None else f"the next comes at {clock(later + 60.0)}"
        raise InputError("--begin", "no order is open at this time of day", mend)
    if scenario.left_out is not None:
        say(f"{scenario.net.name}: {scenario.left_out}")
    if scenario.rsus is not None:
        _check_count(name, scenario.rsus, cameras)
    background = prepare(scenario, seed, folder)
    for line in made_up(scenario, background, seed):
        say(f"made up: {line}")
    _check_count(name, background.rsus, cameras)
    day = day_spec(scenario, background, folder, begin_s=max(from_s, begin_s - WARM_UP_S))
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
