"""Every order that cannot be taken is refused with the field that is in the way and what to do."""

from __future__ import annotations

from typing import Any

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.intake import read_request
from dispatcher_daemon.service.intake.service_area import ServiceArea
from slipstream.messages import OrderRequest
from slipstream.orders import OrderRefused

NOW_NS = 1_800_000_000_000_000_000  # 2027-01-15T08:00:00Z


@pytest.mark.parametrize(
    ("data", "key", "problem"),
    [
        ("parcel", None, "not an object"),
        ({"node": "11"}, "id", "missing key"),
        ({"id": "a\x07", "node": "11"}, "id", "control characters"),
        ({"id": "a\x00", "node": "11"}, "node", "NUL"),
        ({"id": "a", "nodes": "11"}, "nodes", "unknown key"),
        ({"id": "a"}, "node", "it has no place"),
        ({"id": "a", "lat": 1.0}, "node", "one of lat and lon"),
        ({"id": "a", "node": "11", "lat": 1.0, "lon": 1.0}, "node", "it has two places"),
        ({"id": "a", "lat": float("nan"), "lon": 1.0}, "lat", ""),
        ({"id": "a", "node": "11", "demand": 0.5}, "demand", "no whole number"),
        ({"id": "a", "node": "11", "service_s": -1}, "service_s", "-1 is below 0"),
        ({"id": "a", "node": "11", "latest": "2027-01-15T09:00:00"}, "latest", "date and zone"),
        ({"id": "a", "node": "11", "latest": "2027-02-30T09:00:00Z"}, "latest", "no such time"),
        ({"id": "a", "node": "11", "latest": "soon"}, "latest", "no time with its date"),
        ({"id": "a", "node": "11", "earliest": -1}, "earliest", "-1 is below 0"),
        ({"id": "a", "node": "11", "earliest": 1.8e18}, "earliest", "no whole number"),
        (
            {
                "id": "a",
                "node": "11",
                "earliest": "2027-01-15T10:00:00Z",
                "latest": "2027-01-15T10:30:00+01:00",
            },
            "latest",
            "ends before it begins",
        ),
    ],
)
def test_what_is_no_request_names_its_field(data: Any, key: str | None, problem: str) -> None:
    """The first field that is wrong."""
    with pytest.raises(OrderRefused) as caught:
        read_request(data)
    refusal = caught.value.refusal
    assert (refusal.kind, refusal.key) == ("invalid", key)
    assert problem in refusal.problem
    assert refusal.mend


def test_times_are_read_to_the_nanosecond_in_any_zone() -> None:
    """As text or as number, they are one request."""
    read = read_request({"id": "a", "node": "11", "latest": "2027-01-15t09:30:00.123456789+01:30"})
    assert read.latest == NOW_NS + 123_456_789
    assert read == read_request({"id": "a", "node": "11", "latest": NOW_NS + 123_456_789})


@pytest.mark.parametrize(
    ("fields", "key", "problem"),
    [
        ({"latest": NOW_NS}, "latest", "its window closed at 2027-01-15T08:00:00Z, and it is"),
        ({"node": "nowhere"}, "node", "no junction 'nowhere' in network 'town'"),
        ({"lat": 0.7, "lon": 1.4}, "lat", "500 m from the nearest road that its vehicles may use"),
        ({"carrier": "jones"}, "carrier", "no vehicle is of carrier 'jones'"),
        ({"skills": ["lift", "cold"]}, "skills", "no vehicle has all the skills cold, lift"),
        ({"vehicle": "van-7"}, "vehicle", "no vehicle 'van-7'"),
        ({"vehicle": "van-1", "skills": ["lift"]}, "skills", "no vehicle 'van-1' has all"),
        ({"demand": 10}, "demand", "it needs 10, more than a vehicle can take (largest: 9)"),
        (
            {"demand": 6, "carrier": "smith"},
            "demand",
            "it needs 6, more than a vehicle can take (largest: 5)",
        ),
        (
            {"mass_kg": 9000.0, "vehicle": "van-0"},
            "mass_kg",
            "it weighs 9000 kg, more than a vehicle",
        ),
        ({"node": "p"}, "node", "no vehicle gets from its depot to 'p' and back"),
    ],
)
def test_what_no_vehicle_could_ever_serve_is_refused(
    district: RoutingProblem, fields: dict[str, Any], key: str, problem: str
) -> None:
    """Whatever the traffic."""
    place = {} if {"node", "lat"} & fields.keys() else {"node": "11"}
    area = ServiceArea(district.network, district.fleet)
    with pytest.raises(OrderRefused) as caught:
        area.check(read_request({"id": "a", **place, **fields}), NOW_NS)
    refusal = caught.value.refusal
    assert (refusal.order, refusal.kind, refusal.key) == ("a", "invalid", key)
    assert problem in refusal.problem
    assert refusal.mend


@pytest.mark.parametrize("name", ["of-the-file", "depot-0", "depot"])
def test_ids_of_the_fleets_places_are_taken(district: RoutingProblem, name: str) -> None:
    """Stops, depots, and the name that stands for every depot."""
    area = ServiceArea(district.network, district.fleet)
    with pytest.raises(OrderRefused, match="a place of the fleet's file has this id") as caught:
        area.check(OrderRequest(id=name, node="11"), NOW_NS)
    assert caught.value.refusal.kind == "conflict"


def test_a_place_near_a_road_is_served_at_its_junction(district: RoutingProblem) -> None:
    """As the fleet's file does it; what fits is not refused."""
    area = ServiceArea(district.network, district.fleet)
    near = OrderRequest(
        id="a", lat=0.32, lon=0.35, demand=5, carrier="smith", skills=("lift",), latest=NOW_NS + 1
    )
    assert area.check(near, NOW_NS) == "11"
