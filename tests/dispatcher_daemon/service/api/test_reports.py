"""Vehicles that report over HTTP alone, and what the API shows of a vehicle."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from slipstream.messages import VehiclePosition, position_key

from .asgi import Answer
from .conftest import Api


class Vehicle:
    """A vehicle of the demo that has nothing but HTTP."""

    def __init__(self, api: Api, name: str, home: tuple[str, float]) -> None:
        self._api, self._name, self._home = api, name, home
        self._visits: list[dict[str, Any]] = []

    def send(self, what: str, **values: Any) -> Answer:
        """One report; its vehicle and time unless they are given."""
        body = {"vehicle": self._name, "time_ns": time.time_ns(), **values}
        path = f"/v1/vehicles/{self._name}/{what}"
        return self._api.ask("POST", path, "telematics", body)

    def at(
        self, segment: str, share: float, cycle: int | None, leg: int | None, **more: Any
    ) -> Any:
        """Its position, and what it is answered."""
        place = {"segment": segment, "share": share, "cycle": cycle, "leg": leg}
        answer = self.send("position", **{"speed_mps": 0.0, "on_road": False, **place, **more})
        assert answer.status == 200, answer.json
        return answer.json

    def home(self, cycle: int | None = None) -> Any:
        """It stands at its depot."""
        return self.at(*self._home, cycle, None if cycle is None else 0)

    def answers(self, cycle: int, reason: str | None = None) -> Any:
        """Its answer to a plan; a reason refuses it."""
        answer = self.send("acknowledgement", cycle=cycle, accepted=reason is None, reason=reason)
        assert answer.status == 200, answer.json
        return answer.json

    def visits(self, cycle: int | None, *visits: dict[str, Any]) -> Any:
        """What became of stops, beside those of before."""
        self._visits += visits
        answer = self.send("progress", cycle=cycle, visits=self._visits)
        assert answer.status == 200, answer.json
        return answer.json


@pytest.fixture
def van(serve: Callable[..., Api], demo: RoutingProblem) -> tuple[Api, Vehicle]:
    """A served API with tokens, and van-a of the demo at its depot."""
    api = serve(tokens=True)
    assert demo.fleet is not None
    depot = demo.fleet.depot_of(demo.fleet.vehicle_by_id["van-a"]).node
    into = min(name for name, one in demo.network.segments.items() if one.end == depot)
    return api, Vehicle(api, "van-a", (into, 1.0))


_DAY_NS = 24 * 3600 * 10**9


def _get(api: Api, path: str) -> Any:
    answer = api.get(path, "reader")
    assert answer.status == 200, answer.json
    return answer.json


@pytest.mark.slow
def test_a_vehicle_without_a_bus_serves_its_plan(van: tuple[Api, Vehicle]) -> None:
    """It gets its plan, acknowledges it, drives, serves all and is back, over HTTP alone; orders
    and the plan's history show each step.
    """
    api, vehicle = van
    assert vehicle.home()["offered"] is None
    api.dispatcher.run_cycle()
    plan = _get(api, "/v1/plans/van-a")["offered"]["plan"]
    stops = [stop["stop"] for stop in plan["stops"][1:-1]]
    assert stops
    shown = vehicle.answers(1)
    assert (shown["accepted"]["cycle"], shown["accepted"]["status"]) == (1, "acknowledged")
    assert (shown["answer"]["cycle"], shown["answer"]["accepted"]) == (1, True)
    assert [step["status"] for step in _get(api, "/v1/plans/van-a")["accepted"]["history"]] == [
        "published",
        "acknowledged",
    ]
    first = plan["segments"][0]["segment"]
    assert vehicle.at(first, 0.5, 1, 0, on_road=True, speed_mps=8.0)["position"]["share"] == 0.5
    assert _get(api, f"/v1/orders/{stops[0]}")["state"] == "under_way"
    for leg, stop in enumerate(stops, 1):
        into = [one["segment"] for one in plan["segments"] if one["leg"] == leg - 1][-1]
        vehicle.at(into, 1.0, 1, leg)
        now_ns = time.time_ns()
        visit = {"stop": stop, "arrived_ns": now_ns, "ended_ns": now_ns, "reason": None}
        vehicle.visits(1, {**visit, "status": "served"})
        order = _get(api, f"/v1/orders/{stop}")
        assert (order["state"], order["reason"]) == ("served", "served by van-a")
    vehicle.home()
    assert vehicle.visits(None)["accepted"] is None
    api.dispatcher.run_cycle()
    (before,) = (one for one in _get(api, "/v1/plans/van-a")["history"] if one["cycle"] == 1)
    assert before["status"] == "done"
    steps = before["history"]
    assert [step["status"] for step in steps] == ["published", "acknowledged", "done"]
    assert sorted(step["time_ns"] for step in steps) == [step["time_ns"] for step in steps]


def test_a_refusal_over_http_opens_the_orders_again(van: tuple[Api, Vehicle]) -> None:
    """With its reason in the vehicle's answer, in the plan's history and with the order."""
    api, vehicle = van
    vehicle.home()
    api.dispatcher.run_cycle()
    plan = _get(api, "/v1/plans/van-a")["offered"]["plan"]
    shown = vehicle.answers(1, "a flat tyre")
    assert shown["offered"] is None
    assert shown["answer"]["reason"] == "a flat tyre"
    assert _get(api, "/v1/vehicles/van-a")["answer"] == shown["answer"]
    order = _get(api, f"/v1/orders/{plan['stops'][1]['stop']}")
    assert (order["state"], order["reason"]) == ("open", "van-a refused its plan: a flat tyre")
    (refused,) = _get(api, "/v1/plans/van-a")["history"]
    assert (refused["status"], refused["history"][-1]["status"]) == ("refused", "refused")
    assert "a flat tyre" in refused["reason"]


def test_what_is_wrong_with_a_report_is_named(van: tuple[Api, Vehicle]) -> None:
    """Each refusal has field and mend; an unknown vehicle is a 404; nothing of it is taken."""
    api, vehicle = van
    place = {"segment": "avenue_east", "share": 0.5, "speed_mps": 0.0, "on_road": True}
    sound = {**place, "cycle": None, "leg": None}
    visit = {"stop": "s", "status": "failed", "arrived_ns": 1, "ended_ns": 2, "reason": None}
    for what, body, field in (
        ("position", {**sound, "segment": "nowhere"}, "segment"),
        ("position", {**sound, "share": 2.0}, "share"),
        ("position", {**sound, "vehicle": "van-b"}, "vehicle"),
        ("position", {**sound, "cycle": 1}, "leg"),
        ("position", {**sound, "colour": "red"}, "colour"),
        ("acknowledgement", {"cycle": 1, "accepted": True, "reason": "why"}, "reason"),
        ("acknowledgement", {"cycle": "1", "accepted": True, "reason": None}, "cycle"),
        ("progress", {"cycle": 1, "visits": [visit]}, "visits.0"),
        ("progress", {"cycle": 1, "visits": 1001 * [{**visit, "reason": "shut"}]}, "visits"),
    ):
        answer = vehicle.send(what, **body)
        assert (answer.status, answer.json.get("field")) == (422, field), (what, answer.json)
        assert answer.json["mend"], what
    for what in ("position", "acknowledgement", "progress"):
        answer = api.ask("POST", f"/v1/vehicles/nobody/{what}", "telematics", {})
        assert answer.status in (404, 422), what
    answer = Vehicle(api, "nobody", ("", 0.0)).send("position", **sound)
    assert (answer.status, answer.json["field"]) == (404, "vehicle")
    api.dispatcher.run_cycle()
    assert _get(api, "/v1/vehicles/van-a")["reports"] is False


def test_a_vehicle_shows_what_it_is(serve: Callable[..., Api], demo: RoutingProblem) -> None:
    """Depot, type, capacity, skills, shift and breaks by the fleet in use: by the clock where the
    file gives clock times, in seconds elsewhere.
    """
    assert demo.fleet is not None
    api = serve()
    first, second = demo.fleet.vehicles[:2]
    changes = {
        "type": "van",
        "capacity": 7,
        "skills": ("cooled",),
        "carrier": "north",
        "ready": "07:00",
        "depart_by_s": 600.0,
        "breaks": [{"duration_s": 1800.0, "earliest": "11:30", "latest": "13:00"}],
    }
    row = {**first.model_dump(), **changes}
    vehicles = (type(first).model_validate(row), second)
    parts = {**demo.fleet.parts, "vehicles": vehicles, "time_zone": "Europe/Berlin"}
    fleet = type(demo.fleet)(**parts)
    # At noon, when 07:00 has passed: it must not lie after 600 s from now.
    noon_ns = time.time_ns() // _DAY_NS * _DAY_NS + _DAY_NS // 2
    api.dispatcher.fleet_watch.situation(fleet.at(noon_ns), 1, noon_ns, 10.0)
    shown = {one["id"]: one for one in api.get("/v1/vehicles").json["vehicles"]}
    own = shown["van-a"]
    assert own == api.get("/v1/vehicles/van-a").json
    depot = fleet.depot_of(first)
    assert own["depot"] == {"id": depot.id, "node": depot.node}
    assert (own["type"], own["capacity"], own["skills"]) == ("van", 7, ["cooled"])
    assert own["type_data"]["gross_mass_kg"] == 3500.0
    assert (own["carrier"], own["time_zone"]) == ("north", "Europe/Berlin")
    assert own["shift"] == {
        "ready": "07:00",
        "ready_s": None,
        "depart_by": None,
        "depart_by_s": 600.0,
        "return_by": None,
        "return_by_s": None,
    }
    assert own["breaks"] == [
        {
            "duration_s": 1800.0,
            "earliest": "11:30",
            "earliest_s": None,
            "latest": "13:00",
            "latest_s": None,
        }
    ]
    other = shown["van-b"]
    assert (other["type"], other["type_data"], other["skills"]) == (second.type, None, [])
    assert (other["shift"]["ready_s"], other["breaks"]) == (second.ready_s, [])


def test_one_token_does_not_close_orders_that_are_elsewhere(van: tuple[Api, Vehicle]) -> None:
    """Nothing is served by a list of orders: each is at risk, says why, and can be settled."""
    api, vehicle = van
    vehicle.home()
    api.dispatcher.run_cycle()
    orders = [one["order"] for one in _get(api, "/v1/orders")["orders"]]
    assert len(orders) > 2
    now_ns = time.time_ns()
    visit = {"status": "served", "arrived_ns": now_ns, "ended_ns": now_ns, "reason": None}
    shown = vehicle.visits(1, *({**visit, "stop": order} for order in orders))
    assert shown["orders"] == len(
        [one for one in _get(api, "/v1/orders")["orders"] if one["vehicle"] == "van-a"]
    )
    after = {one["order"]: one for one in _get(api, "/v1/orders")["orders"]}
    assert {one["state"] for one in after.values()} == {"planned"}
    for one in after.values():
        assert "van-a says that it has served it" in one["at_risk"]
    first, second = orders[:2]
    for order, served, state in ((first, True, "served"), (second, False, "open")):
        path = f"/v1/orders/{order}/settle"
        assert api.ask("POST", path, "orderer", {"served": served}).status == 403
        assert api.ask("POST", path, "controller", {}).status == 422
        answer = api.ask("POST", path, "controller", {"served": served})
        assert (answer.status, answer.json["state"], answer.json["at_risk"]) == (200, state, None)
    again = api.ask("POST", f"/v1/orders/{first}/settle", "controller", {"served": False})
    assert again.status == 409


def test_nobody_else_places_a_vehicle_that_speaks_for_itself(van: tuple[Api, Vehicle]) -> None:
    """Position and answer of one that is heard on the bus are refused over HTTP."""
    api, vehicle = van
    api.dispatcher.run_cycle()
    own = {"vehicle": "van-a", "time_ns": time.time_ns(), "cycle": None, "leg": None}
    place = {"segment": "avenue_east", "share": 0.5, "speed_mps": 0.0, "on_road": False}
    told = VehiclePosition.model_validate({**own, **place})
    api.dispatcher.fleet_watch.on_position(position_key("van-a"), told.to_bytes())
    answer = vehicle.send("position", **{**place, "share": 0.9, "cycle": None, "leg": None})
    assert (answer.status, answer.json["field"]) == (409, "vehicle")
    assert vehicle.send("acknowledgement", cycle=1, accepted=True, reason=None).status == 409
    shown = _get(api, "/v1/vehicles/van-a")
    assert (shown["position"]["share"], shown["accepted"]) == (0.5, None)
