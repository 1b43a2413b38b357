"""`GET /v1/energy`: sums of the ledger, by period and range."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from slipstream.energy.ledger import HOUR_NS, EnergyHour
from slipstream.orders import FleetRecords
from storage import open_database

from .conftest import Api

BEGIN_NS = 490_000 * HOUR_NS - 490_000 % 24 * HOUR_NS


@pytest.fixture
def api(serve: Callable[..., Api]) -> Api:
    """An API whose ledger has two vehicles, three hours and two days."""
    found = serve()
    figures = (2.0, 1.0, 0.25, 0.5, 0.25, 8000.0, 2000.0)
    rows = [(0, "a"), (0, "b"), (1, "a"), (24, "b")]
    hours = [EnergyHour(BEGIN_NS + n * HOUR_NS, vehicle, *figures) for n, vehicle in rows]
    with open_database(found.services.settings.database_url) as database:
        database.save_fleet(FleetRecords(driven=tuple(hours)))
    return found


def test_sums_by_period(api: Api) -> None:
    """Over all vehicles; hours in which nothing was driven are missing."""
    path = f"/v1/energy?from={BEGIN_NS}&until={BEGIN_NS + 48 * HOUR_NS}&by="
    hours = api.get(f"{path}hour").json["sums"]
    assert [(s["begin_ns"] - BEGIN_NS) // HOUR_NS for s in hours] == [0, 1, 24]
    assert [s["distance_m"] for s in hours] == [16000.0, 8000.0, 8000.0]
    days = api.get(f"{path}day").json
    assert (days["by"], [s["plan_kwh"] for s in days["sums"]]) == ("day", [3.0, 1.0])
    (whole,) = api.get(f"{path}all").json["sums"]
    assert whole["baseline_kwh"] == 8.0
    assert whole["saved_drag_kwh"] == 2.0
    assert whole["platooned_m"] == 8000.0


def test_the_range(api: Api) -> None:
    """Hours count by their begin; without a range it is the last time before `until`."""
    until = BEGIN_NS + 25 * HOUR_NS
    assert len(api.get(f"/v1/energy?by=hour&until={until}").json["sums"]) == 2
    assert len(api.get(f"/v1/energy?until={until}").json["sums"]) == 2
    assert api.get("/v1/energy?by=all").json["sums"][0]["plan_kwh"] == 4.0
    assert api.get("/v1/energy?by=hour").json["sums"] == []


def test_one_vehicle_s_sums(api: Api) -> None:
    """Only what it has driven; one of the fleet that drove nothing has none, any other is a 404."""
    path = f"/v1/energy?by=hour&from={BEGIN_NS}&until={BEGIN_NS + 48 * HOUR_NS}&vehicle="
    hours = api.get(f"{path}a").json["sums"]
    assert [(s["begin_ns"] - BEGIN_NS) // HOUR_NS for s in hours] == [0, 1]
    assert [s["distance_m"] for s in hours] == [8000.0, 8000.0]
    assert api.get("/v1/energy?by=all&vehicle=b").json["sums"][0]["plan_kwh"] == 2.0
    assert api.get(f"{path}van-a").json["sums"] == []
    unknown = api.get(f"{path}nobody")
    assert (unknown.status, unknown.json["field"]) == (404, "vehicle")
    assert unknown.json["mend"]


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("from=7&until=6", "from"),
        ("by=hour&from=0", "from"),
        ("by=week", "by"),
        ("since=1", "since"),
        ("from=-1", "from"),
        ("vehicle=", "vehicle"),
    ],
)
def test_refusals(api: Api, query: str, field: str) -> None:
    """Each names the parameter."""
    answer = api.get(f"/v1/energy?{query}")
    assert (answer.status, answer.json["field"]) == (422, field)
