"""The WZDx DeviceFeed: status, figures and place of each device, and that it is always valid."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dispatcher_daemon.service.feeds import device_feed, find_sites, measurements, watched_pairs
from dispatcher_daemon.settings import FeedSettings
from slipstream.messages import RsuHealth, SegmentState
from slipstream.roads import RoadNetwork
from tests.dispatcher_daemon.service.feeds.conftest import Check
from tests.dispatcher_daemon.service.feeds.states import NOW_NS, any_state, features, health, state

SEGMENTS = ("avenue_east", "avenue_west")


def document(
    roads: RoadNetwork,
    states: Sequence[SegmentState],
    healths: Sequence[RsuHealth] = (),
    rsus: Mapping[str, tuple[str, ...]] | None = None,
) -> bytes:
    """The feed of some states and healths."""
    sites = find_sites(roads, watched_pairs(rsus, states, healths))
    measured = measurements(sites, states, roads, NOW_NS)
    by_rsu = {each.rsu: each for each in healths}
    return device_feed(measured, by_rsu, FeedSettings(publisher="Troy"), NOW_NS)


def devices(feed: bytes) -> dict[str, dict[str, Any]]:
    """Its features by id."""
    return {feature["id"]: feature for feature in json.loads(feed)["features"]}


def test_a_device_tells_speed_and_volume_where_it_stands(roads: RoadNetwork) -> None:
    """In the standard's units; longitude first."""
    feed = document(roads, [state(measured=features())], [health()])
    device = devices(feed)["rsu-1/avenue_east"]
    sensor = device["properties"]
    assert sensor["average_speed_kph"] == pytest.approx(45.0)
    assert sensor["volume_vph"] == pytest.approx(900.0)
    assert sensor["core_details"]["device_status"] == "ok"
    assert sensor["collection_interval_start_date"] == "2027-01-15T07:59:49.123Z"
    longitude, latitude = device["geometry"]["coordinates"]
    assert roads.projection is not None
    x, y = roads.projection.place_m(latitude, longitude)
    begin, end = roads.segments["avenue_east"].shape
    half_way = (begin[0] + end[0]) / 2, (begin[1] + end[1]) / 2
    assert (x, y) == pytest.approx(half_way, abs=0.02)
    source = sensor["core_details"]["data_source_id"]
    assert [s["data_source_id"] for s in json.loads(feed)["feed_info"]["data_sources"]] == [source]


@pytest.mark.parametrize(
    ("states", "healths", "status"),
    [
        ([state(measured=features())], [health(fault="obscured")], "error"),
        ([], [health(status="no_signal")], "error"),
        ([], [health(status="ended")], "error"),
        ([], [health()], "ok"),
        ([], [health(age_s=6.0)], "unknown"),
        ([], [], "unknown"),
        ([state(measured=features())], [], "ok"),
        ([state(measured=features(), age_s=6.0)], [], "unknown"),
        ([state(y_e=None, reason="uncertain", measured=features())], [], "unknown"),
        ([state(y_e=None, reason="frozen")], [], "error"),
    ],
)
def test_a_status_is_what_the_rsu_last_told(
    roads: RoadNetwork, states: list[SegmentState], healths: list[RsuHealth], status: str
) -> None:
    """Its health first, then its state; nothing fresh is unknown."""
    feed = document(roads, states, healths, {"rsu-1": ("avenue_east",)})
    core = devices(feed)["rsu-1/avenue_east"]["properties"]["core_details"]
    assert core["device_status"] == status


def test_unknown_has_no_figure(roads: RoadNetwork) -> None:
    """No zero stands for what was not measured."""
    stale = state(measured=features(), age_s=6.0)
    sensor = devices(document(roads, [stale], [health()]))["rsu-1/avenue_east"]["properties"]
    assert not {"average_speed_kph", "volume_vph", "occupancy_percent"} & set(sensor)
    assert sensor["core_details"]["status_messages"] == ["stability unknown: stale"]


FEW = settings(max_examples=20, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@FEW
@given(states=st.lists(any_state(SEGMENTS), max_size=4))
def test_any_states_give_a_feed_of_the_right_form(
    roads: RoadNetwork, states: list[SegmentState]
) -> None:
    """Each device once, and figures that a road can have."""
    rsus = {each.rsu: SEGMENTS for each in states}
    feed = document(roads, states, (), rsus)
    assert len(json.loads(feed)["features"]) == len(devices(feed)) == len(rsus) * len(SEGMENTS)
    for device in devices(feed).values():
        assert 0 <= device["properties"].get("average_speed_kph", 0) <= 70 * 3.6
        interval = [device["properties"][f"collection_interval_{e}_date"] for e in ("start", "end")]
        assert interval == sorted(interval)


@FEW
@given(states=st.lists(any_state(SEGMENTS), max_size=4))
def test_any_states_give_a_feed_that_the_official_schema_accepts(
    roads: RoadNetwork, official_wzdx: Check, states: list[SegmentState]
) -> None:
    """WZDx 4.2."""
    healths = [health(), health("rsu-2", fault="dark"), health("rsu-3", age_s=60.0)]
    official_wzdx(document(roads, states, healths))
    official_wzdx(document(roads, states, healths, {each.rsu: SEGMENTS for each in states}))


def test_no_time_is_ahead_of_the_feed_itself(roads: RoadNetwork) -> None:
    """A device whose clock is ahead has no interval, for its own cannot be true."""
    ahead = state(measured=features(), age_s=-3600.0)
    feed = document(roads, [ahead], [health(age_s=-0.5)])
    sensor = devices(feed)["rsu-1/avenue_east"]["properties"]
    now = json.loads(feed)["feed_info"]["update_date"]
    assert sensor["core_details"]["update_date"] == now
    assert sensor["collection_interval_end_date"] == now
