"""Moments of the kept past, energy, the report of a day and tables, as browsers ask for them."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from pydantic import TypeAdapter

import storage
from dashboard.settings import DashboardSettings
from dashboard.view.places import Places
from dashboard.web.app import make_app
from dashboard.web.energy import EnergyBook, local, zone_of
from dashboard.web.past import StoredPast
from dashboard.web.report import clock
from dashboard.web.services import PageServices
from dashboard.web.tables.rows import Scene
from slipstream.http.server import HttpServer
from tests.dashboard.web.conftest import Served
from tests.dashboard.web.contract import SHAPES
from tests.dashboard.web.past.stored import S, store_run

MS = 1_000_000


@dataclass
class Run:
    """A served finished run, and when it began."""

    served: Served
    begin_ns: int

    def get(self, path: str) -> Any:
        """The JSON of an answer."""
        answer = self.served.get(path)
        assert answer.status == 200, answer.body
        return answer.json

    def at(self, after_s: float) -> Any:
        """The moment so long after the begin."""
        return self.get(f"/api/at?t={self.ms(after_s)}")

    def ms(self, after_s: float) -> int:
        """A moment as browsers name it."""
        return self.begin_ns // MS + round(after_s * 1000)


def holds(shape: str, answer: object) -> None:
    """Hold an answer against what docs/page.md says."""
    TypeAdapter(SHAPES[shape]).validate_python(answer)


@pytest.fixture(scope="module")
def begin_ns() -> int:
    """Begin of the run, 20:47 UTC of a Wednesday."""
    return 1_795_000_000 * S - 1_795_000_000 % 86_400 * S + 74_820 * S


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory, world: Any, begin_ns: int) -> str:
    """Database of the run."""
    found = f"sqlite:///{tmp_path_factory.mktemp('run') / 'run.db'}"
    store_run(found, world, begin_ns)
    return found


@pytest.fixture(scope="module")
def run(url: str, world: Any, begin_ns: int) -> Iterator[Run]:
    """The run, served."""
    settings = DashboardSettings(
        database_url=url,
        time_zone="Europe/Berlin",
        co2_kg_per_kwh=0.4,
        price_per_kwh=0.25,
        title="Depot & Söhne",
    )
    scene = Scene(Places(world.network), {"depot": "depot"}, {"van-c": "Käse & Co"})
    with storage.open_reader(url) as reader:
        energy = EnergyBook(reader, zone_of("Europe/Berlin"), settings.factors)
        past = StoredPast(reader, scene, energy, None)
        last = past.span()
        assert last is not None
        services = PageServices(settings, scene, lambda: past.at(last[1]), past=past, reader=reader)
        server = HttpServer("the page", "127.0.0.1", 0, "port")
        server.start(make_app(services))
        yield Run(Served(server.port, None, None, None, None, services), begin_ns)  # type: ignore[arg-type]
        server.close()


def test_the_range_is_that_of_what_is_stored(run: Run) -> None:
    """Its ends are moments that can be asked for; others and none are refused."""
    found = run.get("/api/past")
    assert found == {"first": run.ms(0), "last": run.ms(600)}
    assert run.get("/api/config")["live"] is False
    for t in found.values():
        assert run.get(f"/api/at?t={t}")["t"] == pytest.approx(t, abs=500)
    for t in (found["first"] - 1000, found["last"] + 1000, 0):
        refused = run.served.get(f"/api/at?t={t}")
        assert (refused.status, refused.json["status"]) == (404, 404)
    assert run.served.get("/api/at").status == 422
    assert run.served.get("/api/at?t=-1").status == 422


def test_a_moment_is_whole(run: Run) -> None:
    """Vans are where their plans put them, roads as they were measured then."""
    moment = run.at(40)
    holds("Moment", moment)
    assert (moment["live"], moment["paused"]) == (False, False)
    van = moment["vehicles"]["van-a"]
    assert (van["source"], van["state"], van["cycle"]) == ("planned", "planned", 1)
    assert van["x"] is not None
    assert van["road"] in ("depot_road_east", "mill_street_east")
    assert moment["vehicles"]["van-c"]["state"] == "idle"
    assert moment["vehicles"]["van-c"]["carrier"] == "Käse & Co"
    east, west = moment["roads"]["avenue_east"], moment["roads"]["avenue_west"]
    assert (east["flag"], east["gate"], east["kmh"], east["vehicles"]) == ("stable", "open", 54, 9)
    assert (west["flag"], west["gate"]) == ("turbulent", "closed")
    assert east["rsu"] == "rsu-avenue_east"
    rsu = moment["rsus"]["rsu-avenue_east"]
    assert (rsu["level"], rsu["segments"], rsu["picture"]) == ("ok", ["avenue_east"], False)
    assert set(moment["cycles"]) == {"1"}
    assert moment["energy"]["last_cycle"]["saved_kwh"] == 0.071
    assert moment["status"]["level"] == "ok"


def test_plans_change_and_end(run: Run) -> None:
    """Of a van that was given no plan the older one holds until its tour is over."""
    assert run.at(299)["vehicles"]["van-b"]["cycle"] == 1
    assert run.at(301)["vehicles"]["van-b"]["cycle"] == 2
    last = run.at(599.9)
    assert (last["vehicles"]["van-a"]["cycle"], last["vehicles"]["van-b"]["cycle"]) == (2, 2)
    van_b = last["vehicles"]["van-b"]
    assert (van_b["state"], van_b["text"]) == ("planned", "by plan: at c3")
    end = run.at(600)
    assert end["vehicles"]["van-a"]["cycle"] == 3
    assert end["roads"]["avenue_east"]["flag"] == "turbulent"
    # The flag of the minute closes the platoon on the road at once.
    index = run.get("/api/network")["roads"]
    number = next(n for n, road in enumerate(index) if road["id"] == "avenue_east")
    assert [number, 0] in end["vehicles"]["van-a"]["route"]
    assert [number, 1] in run.at(310)["vehicles"]["van-a"]["route"]


def test_orders_are_those_of_the_moment(run: Run) -> None:
    """State, reason and lateness."""
    assert run.at(5)["orders"]["mill"]["state"] == "open"
    planned = run.at(20)["orders"]["mill"]
    assert (planned["state"], planned["why"], planned["vehicle"]) == (
        "planned",
        "became planned",
        "van-a",
    )
    served = run.at(500)["orders"]
    assert (served["mill"]["state"], served["mill"]["late_s"]) == ("served", 100)
    assert (served["dock"]["state"], served["dock"]["level"]) == ("failed", "bad")


def test_alarms_are_those_of_the_moment(run: Run) -> None:
    """Not yet, in force, acknowledged, ended."""
    assert run.at(299)["alarms"] == {}
    begun = run.at(310)
    assert begun["status"]["text"] == "rsu-avenue_west is <silent>"
    alarm = begun["alarms"]["a-1"]
    assert (alarm["ended"], alarm["by"], alarm["acknowledged"]) == (None, None, None)
    assert begun["rsus"]["rsu-avenue_west"]["level"] == "bad"
    acknowledged = run.at(370)
    assert acknowledged["alarms"]["a-1"]["by"] == "anna"
    # As live: an alarm that is seen to is a warning, in the banner and on its row.
    assert acknowledged["status"]["level"] == "warn"
    assert begun["status"]["level"] == "bad"
    over = run.at(450)
    assert over["alarms"]["a-1"]["ended"] == run.ms(420)
    assert over["status"]["count"] == 0


def test_rows_of_the_past_have_the_fields_of_the_present(
    run: Run, serve: Callable[..., Served], world: Any, now_ns: int
) -> None:
    """No field is missing in a row, whatever made it."""
    live = serve()
    for vehicle in ("van-a", "van-b"):
        live.live.add_history((), (world.plan(vehicle, 1, now_ns),))
    live.live.add_history((world.cycle(1, now_ns),), ())
    state, health = world.state("avenue_east", now_ns), world.health("avenue_east", now_ns)
    live.live.on_state(f"slipstream/v1/rsu/{state.rsu}/segment/avenue_east/state", state.to_bytes())
    live.live.on_rsu_health(
        f"slipstream/v1/rsu/{health.rsu}/health", health.model_dump_json().encode()
    )
    live.present.update(now_ns)
    present, past = live.present.known().moment, run.at(310)
    assert set(past) == set(present)
    for table in ("vehicles", "roads", "rsus", "cycles", "alarms"):
        for row in past[table].values():
            for other in present[table].values():
                assert set(row) == set(other), table
    assert set(past["energy"]) == set(present["energy"])
    assert set(past["status"]) == set(present["status"])


def test_cards_of_the_past(run: Run) -> None:
    """Each kind, at the moment that is asked for."""
    t = run.ms(310)
    van = run.get(f"/api/vehicles/van-a?t={t}")
    holds("VehicleCard", van)
    holds("RoadCard", run.get(f"/api/roads/avenue_east?t={t}"))
    holds("RsuCard", run.get(f"/api/rsus/rsu-avenue_east?t={t}"))
    holds("OrderCard", run.get(f"/api/orders/%3Dlate?t={t}"))
    holds("Moment", run.at(310))
    assert van["plan"]["cycle"] == 2
    road = run.get(f"/api/roads/avenue_east?t={t}")
    assert road["flag"] == "stable"
    assert len(road["hour"]["t"]) == 2
    speed = next(one for one in road["features"] if one["name"] == "mean speed")
    assert (speed["value"], speed["unit"], speed["threshold"]) == (54.0, "km/h", None)
    assert run.get(f"/api/roads/avenue_east?t={run.ms(200)}")["features"] == []
    rsu = run.get(f"/api/rsus/rsu-avenue_east?t={t}")
    assert (rsu["faults"], rsu["frames"], rsu["level"]) == (None, None, "ok")
    assert run.get(f"/api/rsus/rsu-avenue_east?t={t}")["segments"] == ["avenue_east"]
    order = run.get(f"/api/orders/%3Dlate?t={run.ms(20)}")
    assert [step["state"] for step in order["history"]] == ["open", "planned"]
    assert run.served.get(f"/api/vehicles/nobody?t={t}").status == 404


def test_cards_say_why_as_the_cycle_did(run: Run) -> None:
    """A vehicle's energy against the same drive alone, its stops and the platoons it does not have;
    all of a cycle; nothing of one that is not stored.
    """
    van = run.get(f"/api/vehicles/van-a?t={run.ms(310)}")
    plan = van["plan"]
    assert plan["alone_kwh"] == pytest.approx(plan["energy_kwh"] * 4 / 3, abs=2e-3)
    assert van["saved_kwh"] == pytest.approx(plan["energy_kwh"] / 3, abs=2e-3)
    assert van["why_route"] == [
        "Serves mill, as in the baseline",
        "Needs 0.7500 kWh, alone on the same way 1.0000 kWh: platoons save 0.2500 kWh over 200 m",
        "That is 0.2500 kWh less than in the baseline; it drives for 1 min 40 s, there for "
        "1 min 30 s",
    ]
    assert van["why_platoon"][0].startswith("With van-b for ")
    refused = "van-a and van-b on bridge: not together in time, 61.5 s apart"
    assert van["why_platoon"][-1].startswith(f"Not: {refused}")
    cycle = run.get("/api/cycles/2")
    holds("CycleCard", cycle)
    told = cycle["explain"]
    assert [one["id"] for one in told["vehicles"]] == ["van-a", "van-b"]
    assert "leads van-b in platoon" in told["vehicles"][0]["lines"][-1]
    assert told["summary"][0] == "Cycle 2: ok"
    assert told["refused"][0].startswith(refused)
    assert told["notes"] == []
    # Plans as they are followed tell no more than what is stored of their cycle.
    assert run.served.services.words.of_cycle(99, 0) is None


def test_energy_by_hour_and_day(run: Run) -> None:
    """The two hours of the run lie on one day in Berlin."""
    hours = run.get("/api/energy?by=hour")["rows"]
    for hour in hours:
        holds("EnergySum", {name: value for name, value in hour.items() if name != "t"})
    assert [row["plan_kwh"] for row in hours] == [3.0, 3.0]
    (day,) = run.get("/api/energy?by=day")["rows"]
    assert (day["saved_kwh"], day["km"], day["platoon_km"], day["co2_kg"]) == (2.0, 40.0, 16.0, 0.8)
    assert (run.begin_ns // MS - day["t"]) < 86_400_000
    later = run.get(f"/api/energy?by=hour&from={hours[1]['t']}")["rows"]
    assert later == hours[1:]
    # The run takes ten minutes of the second hour: nothing counts before it is driven.
    half = run.get(f"/api/energy?by=hour&from={hours[0]['t']}&until={run.ms(300)}")["rows"]
    assert [row["plan_kwh"] for row in half] == [3.0, 1.5]
    sums = [run.at(after_s)["energy"]["today"]["plan_kwh"] for after_s in (0, 300, 600)]
    assert sums == [pytest.approx(kwh, abs=0.01) for kwh in (3.0, 4.5, 6.0)]
    assert run.served.get("/api/energy?by=year").status == 422
    assert run.served.get("/api/energy?by=hour&from=0").status == 422


def test_tables_as_csv(run: Run) -> None:
    """Each table; what an order is called is no formula."""
    for table in ("vehicles", "roads", "rsus", "cycles", "alarms", "energy"):
        answer = run.served.get(f"/api/export/{table}.csv?t={run.ms(310)}")
        assert (answer.status, answer.headers["content-type"]) == (200, "text/csv; charset=utf-8")
        assert list(csv.DictReader(io.StringIO(answer.body.decode()))), table
    answer = run.served.get(f"/api/export/orders.csv?t={run.ms(20)}")
    found = {row["order"]: row for row in csv.DictReader(io.StringIO(answer.body.decode()))}
    assert found["'=late"]["state"] == "planned"
    name = answer.headers["content-disposition"]
    assert re.fullmatch(r'attachment; filename="depot-s-hne-orders-\d{8}-\d{6}\.csv"', name)
    assert run.served.get("/api/export/tokens.csv").status == 404


def test_rows_as_they_are_shown(run: Run) -> None:
    """Those that were asked for, in that order; one that has gone is left out."""

    def ask(body: object, table: str = "orders") -> Any:
        path = f"/api/export/{table}.csv?t={run.ms(20)}"
        return run.served.ask("POST", path, body=json.dumps(body).encode())

    answer = ask({"ids": ["mill", "gone", "=late"]})
    assert answer.status == 200
    assert [line.split(",")[0] for line in answer.body.decode().splitlines()] == [
        *("order", "mill", "'=late")
    ]
    assert "-orders-" in answer.headers["content-disposition"]
    assert ask({"ids": [f"order-{n}" for n in range(5000)]}).status == 200
    for body, table, status in (
        ({"ids": ["x" * 300_000]}, "orders", 413),
        ([], "orders", 422),
        ({"ids": [1]}, "orders", 422),
        ({"ids": ["x" * 600]}, "orders", 422),
        ({"ids": []}, "energy", 404),
    ):
        refused = ask(body, table)
        assert (refused.status, refused.json["status"]) == (status, status)


def test_the_report_of_a_day(run: Run) -> None:
    """Its figures, and nothing that a name could bring in."""
    answer = run.served.get("/report")
    assert answer.status == 200
    text = answer.body.decode()
    assert "Depot &amp; Söhne" in text
    # Of a finished run the last day is meant.
    first = run.served.get(f"/report?day={_day_of(run)}").body.decode()
    assert [line for line in text.splitlines() if "Printed" not in line] == [
        line for line in first.splitlines() if "Printed" not in line
    ]
    assert "&lt;silent&gt;" in first
    assert "<silent>" not in first
    plain = re.sub(r"<[^>]*>", " ", first)
    plain = re.sub(r"\s+", " ", plain)
    assert "2.0 kWh saved, 25.0 %" in plain
    assert "each van alone on its cheapest route" in plain
    assert "16.0 km in platoons, of 40.0 driven" in plain
    assert "Served 1 of them late 1 Failed 1" in plain
    assert "1 critical, 0 warnings" in plain
    assert "Planned 3 of them better than the baseline 3" in plain
    assert "style=" not in first
    empty = run.served.get("/report?day=2020-02-29")
    assert "Nothing is kept of this day: the past is kept from 20" in empty.body.decode()
    assert "Nothing was driven" in empty.body.decode()
    for day in ("yesterday", "2026-02-30", "0001-01-01", "9999-12-31"):
        assert run.served.get(f"/report?day={day}").status == 422, day


def test_a_clock_time_is_the_nearest_minute() -> None:
    """A window's end that a calculation left a hair short is no minute less."""
    nine_ns = 1_795_000_020 * 10**9 // (60 * 10**9) * 60 * 10**9
    zone = ZoneInfo("UTC")
    assert {clock(nine_ns + hair, zone) for hair in (-1, -400, 0, 400)} == {clock(nine_ns, zone)}


def _day_of(run: Run) -> str:
    return str(local(run.begin_ns, zone_of("Europe/Berlin")).date())


@pytest.mark.long
def test_the_report_is_one_printed_page(browser: Any, run: Run, tmp_path: Path) -> None:
    """As Chromium prints it, on A4; style and chart come through the page's policy."""
    faults: list[str] = []
    page = browser.new_page()
    page.on("console", lambda message: faults.append(message.text))
    page.goto(f"http://127.0.0.1:{run.served.port}/report?day={_day_of(run)}")
    printed = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b", printed)) == 1
    assert page.locator("svg rect.plan").count() == 24
    assert page.locator("h1").evaluate("e => getComputedStyle(e).fontSize") == "20px"
    page.close()
    assert faults == []
