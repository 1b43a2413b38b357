from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest

from dispatcher_daemon.fleet import fleet_from
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.settings import (
    CitySettings,
    DispatcherSettings,
    OrderSettings,
    SearchSettings,
)
from slipstream.messages import OrderRequest
from slipstream.roads import RoadNetwork

SETTINGS = DispatcherSettings(
    solvers=("exact",),
    city=CitySettings(
        search=SearchSettings(rounds=1, iterations_per_stop=10, workers=1, time_limit_s=2.0),
        second_rounds=0,
        max_sweeps=1,
    ),
    orders=OrderSettings(bundle_s=0.0),
)


@dataclass(frozen=True)
class Grid:
    """A projection in which a degree is a kilometre."""

    def place_m(self, lat: float, lon: float) -> tuple[float, float]:
        """East, north, m."""
        return 1000.0 * lon, 1000.0 * lat


def request(name: str, **fields: Any) -> OrderRequest:
    """A request for an order at junction 11, unless told otherwise."""
    place = {} if "lat" in fields or "node" in fields else {"node": "11"}
    return OrderRequest(id=name, **place, **fields)


@pytest.fixture(scope="session")
def district(town: Callable[..., Any]) -> RoutingProblem:
    """The town with a projection, a stop of the file, and two vans that differ."""
    problem, _ = town(
        [{"id": "of-the-file", "node": "01"}],
        [
            {"capacity": 5, "carrier": "smith", "skills": ["lift"], "type": "van"},
            {"capacity": 9},
        ],
    )
    network: RoadNetwork = replace(problem.network, projection=Grid())  # type: ignore[arg-type]
    # Nobody's stop: what is submitted is all there is to plan.
    data = problem.fleet.model_dump(mode="json", exclude_none=True)
    return replace(problem, network=network, fleet=fleet_from(data, network, "district"))
