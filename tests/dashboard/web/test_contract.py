"""Answers are what docs/page.md says, field by field."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from pydantic import TypeAdapter

from dashboard.web.routes import card_parts
from slipstream.messages import (
    ALARMS_KEY,
    CYCLE_KEY,
    Alarm,
    Alarms,
    PlannedStop,
    StoppedVehicle,
    StoppedVehicles,
    VehiclePosition,
    counts_key,
    plan_key,
    position_key,
    stopped_key,
)
from slipstream.orders import OrderRecord
from storage import RollUp
from storage.traffic.rollups import Spread
from tests.dispatcher_daemon.service.feeds.states import counts

from .contract import SHAPES, names

S = 1_000_000_000
DOC = Path(__file__).parents[3] / "docs" / "page.md"


def _holds(shape: str, answer: object) -> None:
    TypeAdapter(SHAPES[shape]).validate_python(answer)


@pytest.fixture
def page(serve, tell, world, now_ns):
    """The page of a small world that has one of everything."""
    page = serve()
    tell(page, now_ns)
    page.live.on_cycle(CYCLE_KEY, world.cycle(3, now_ns).to_bytes())
    for van in ("van-a", "van-b"):
        plan = world.plan(van, 3, now_ns)
        depot = PlannedStop(
            stop="depot", node="depot", arrival_ns=plan.depart_ns, departure_ns=plan.depart_ns
        )
        plan = plan.model_copy(update={"stops": (depot, *plan.stops, depot)})
        page.live.on_plan(plan_key(van), plan.to_bytes())
    position = VehiclePosition(
        vehicle="van-a",
        time_ns=now_ns,
        segment="avenue_east",
        share=0.5,
        speed_mps=12.0,
        on_road=True,
        cycle=3,
        leg=1,
        charge_kwh=31.5,
    )
    page.live.on_position(position_key("van-a"), position.to_bytes())
    stopped = StoppedVehicles(
        rsu="rsu-avenue_east",
        segment="avenue_east",
        time_ns=now_ns,
        vehicles=(StoppedVehicle(lane=0, along_m=12.4, since_ns=now_ns - 9 * S, seen_ns=now_ns),),
        y_e=1,
        mean_speed_mps=15.0,
    )
    quarter_ns = 900 * S
    counted = msgspec.structs.replace(
        counts(rsu=stopped.rsu),
        began_ns=now_ns // quarter_ns * quarter_ns - quarter_ns,
        until_ns=now_ns // quarter_ns * quarter_ns,
    )
    page.live.on_counts(counts_key(counted.rsu, counted.segment), counted.to_bytes())
    page.live.on_stopped(stopped_key(stopped.rsu, stopped.segment), stopped.to_bytes())
    alarm = Alarm(
        id="a-1",
        severity="warning",
        kind="rsu_silent",
        subject="rsu/rsu-x",
        since_ns=now_ns,
        ended_ns=None,
        text="rsu-x is silent",
        mend="look at it",
    )
    page.live.on_alarms(ALARMS_KEY, Alarms(time_ns=now_ns, alarms=(alarm,)).to_bytes())
    page.live.tell(
        orders=(
            OrderRecord(
                order="mill/1",
                node="mill",
                service_s=60.0,
                demand=2,
                earliest_ns=now_ns,
                latest_ns=now_ns + 100 * S,
                state="planned",
                since_ns=now_ns,
                reason="planned",
                vehicle="van-a",
                cycle=3,
                request={"id": "mill/1", "mass_kg": 3.5, "skills": ["cold"]},
            ),
        )
    )
    page.present.update(now_ns)
    return page


def test_what_is_told_once_and_what_is_told_all_the_time(page, tell, now_ns):
    """Config, network, moment and delta."""
    _holds("Config", page.get("/api/config").json)
    network = page.get("/api/network", accept_encoding="gzip").json
    _holds("Network", network)
    stream = page.follow()
    _, moment = stream.next()
    _holds("Moment", moment)
    assert {table for table, rows in moment.items() if isinstance(rows, dict) and rows} >= {
        *("vehicles", "roads", "rsus", "orders", "cycles", "alarms")
    }
    tell(page, now_ns + 9 * S, speed_mps=3.0)
    page.present.update(now_ns + 9 * S)
    _holds("Delta", stream.next()[1])


@pytest.mark.parametrize(
    ("shape", "path"),
    [
        ("VehicleCard", "/api/vehicles/van-a"),
        ("VehicleCard", "/api/vehicles/van-b"),
        ("RoadCard", "/api/roads/avenue_east"),
        ("RsuCard", "/api/rsus/rsu-avenue_east"),
        ("OrderCard", "/api/orders/mill%2F1"),
        ("CycleCard", "/api/cycles/3"),
    ],
    ids=lambda value: value.replace("/", "."),
)
def test_cards(page, shape, path):
    """Each has its row and what more is known."""
    answer = page.get(path)
    assert answer.status == 200, answer.body
    _holds(shape, answer.json)


def test_the_hour_has_mean_least_and_most_of_each_feature(now_ns):
    """In the page's units; the spread of speed as a share of the minute's speed."""
    features = {
        "mean_speed_mps": Spread(10.0, 8.0, 12.0),
        "mean_acceleration_mps2": Spread(-0.05, -0.2, 0.1),
        "speed_std_mps": Spread(2.0, 1.0, 3.0),
    }
    minute = RollUp("a", 60, now_ns, 60, 40, 20, 60, 0, 3.0, 5, features)
    told = card_parts.hour([minute])
    _holds("Hour", told)
    assert [told[name] for name in ("kmh", "kmh_low", "kmh_high")] == [[36.0], [28.8], [43.2]]
    assert [told[f"acceleration{part}"] for part in ("", "_low", "_high")] == [
        [-0.05],
        [-0.2],
        [0.1],
    ]
    assert [told[name] for name in ("cv", "cv_low", "cv_high")] == [[0.2], [0.1], [0.3]]
    assert told["headway_low"] == [None]


def test_the_page_names_each_field():
    """docs/page.md has each shape with all of its fields."""
    text = DOC.read_text()
    for shape, type_ in SHAPES.items():
        head = f"### {shape}\n"
        assert head in text, shape
        section = text.partition(head)[2].partition("\n#")[0]
        missing = [name for name in names(type_) if f"`{name}`" not in section]
        assert not missing, (shape, missing)
