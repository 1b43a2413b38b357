"""What the dispatcher hands to the routes of its API."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from dispatcher_daemon.service.alarms import AlarmWatch
from dispatcher_daemon.service.api.hub import EventHub
from dispatcher_daemon.service.api.solving import SolveJobs
from dispatcher_daemon.service.dispatcher import Control
from dispatcher_daemon.service.feeds.publisher import Feeds
from dispatcher_daemon.service.fleet_watch import FleetWatch
from dispatcher_daemon.service.intake import OrderIntake
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.traffic import LatestStates
from slipstream.roads import RoadNetwork
from storage import Reader

Check = Callable[[], str | None]
"""Why something is not ready, in words; None: it is."""


@dataclass(frozen=True)
class Services:
    """The dispatcher as routes see it. All of it may be called from any thread, and nothing in it
    waits for a running cycle.

    Attributes:
        events: that callers follow; what happens is published there.
        is_live: the condition that feeds the watchdog.
        awaited: by check, what has not come since the start and may be about to.
    """

    settings: DispatcherSettings
    network: RoadNetwork
    fleet: FleetWatch
    states: LatestStates
    orders: OrderIntake
    feeds: Feeds
    reader: Reader
    alarms: AlarmWatch
    control: Control
    events: EventHub
    solve_jobs: SolveJobs
    is_live: Callable[[], bool]
    solver_fault: Check
    checks: Mapping[str, Check]
    awaited: Callable[[], Mapping[str, str]] = dict


def _services(request: Request) -> Services:
    found: Services = request.app.state.services
    return found


Dispatch = Annotated[Services, Depends(_services)]
"""A route's parameter of this type is the services."""
