"""What was driven by the plans in force, set against the baseline: the energy ledger's sums."""

from __future__ import annotations

import time
from typing import Annotated, Final, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from dispatcher_daemon.service.api.auth import requires
from dispatcher_daemon.service.api.endpoints.vehicles import unknown_vehicle
from dispatcher_daemon.service.api.parameters import Moment, check_range
from dispatcher_daemon.service.api.services import Dispatch
from slipstream.energy.ledger import HOUR_NS, EnergySum
from slipstream.http.problems import Problem

router = APIRouter(prefix="/v1/energy", tags=["energy"], dependencies=[requires("read")])

_MAX_HOURS: Final = 24 * 400
"""Of one answer by hour."""
_DEFAULT_NS: Final = {"hour": 24 * HOUR_NS, "day": 30 * 24 * HOUR_NS}


class EnergyPage(BaseModel):
    """Sums over all vehicles, or of one, oldest first; hours and days in which nothing was driven
    are missing.

    The three saved parts add up to `baseline_kwh` less `plan_kwh`.
    """

    by: Literal["hour", "day", "all"]
    sums: list[EnergySum] = Field(description="Each begins at `begin_ns`; days are those of UTC.")


@router.get("")
def energy(
    dispatch: Dispatch,
    by: Annotated[Literal["hour", "day", "all"], Query(description="Period of a sum.")] = "day",
    since: Annotated[
        Moment,
        Query(
            alias="from",
            description="UTC in ns; hours that begin earlier are left out. Else: a day before "
            "`until` by hour, 30 days by day, all that is kept by all.",
        ),
    ] = None,
    until: Annotated[
        Moment,
        Query(description="UTC in ns; hours that begin then or later are left out; else now."),
    ] = None,
    vehicle: Annotated[
        str | None, Query(min_length=1, max_length=200, description="Of this one; else of all.")
    ] = None,
) -> EnergyPage:
    """Energy and way of the fleet, or of one vehicle, by the plans that were in force, as far as
    vehicles have reported that they drove them, with what the cycles' baselines would have needed.
    """
    end_ns = time.time_ns() if until is None else until
    begin_ns = max(0, end_ns - _DEFAULT_NS.get(by, end_ns)) if since is None else since
    check_range(begin_ns, end_ns)
    if by == "hour" and end_ns - begin_ns > _MAX_HOURS * HOUR_NS:
        mend = f"ask for {_MAX_HOURS} hours at most, or by day"
        raise Problem(422, "too many hours", mend, field="from")
    sums = dispatch.reader.energy_sums(begin_ns, end_ns, by=by, vehicle=vehicle)
    if vehicle is not None and not sums and not dispatch.fleet.knows(vehicle):
        raise unknown_vehicle(vehicle)
    return EnergyPage(by=by, sums=list(sums))
