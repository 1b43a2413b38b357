"""DATEX II publications: what is measured, what is not, and that any states give valid ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from dispatcher_daemon.service.feeds import (
    EXTENSION_SCHEMA,
    find_sites,
    measured_data,
    measurements,
    site_table,
    watched_pairs,
)
from dispatcher_daemon.settings import FeedSettings
from slipstream.errors import InputError
from slipstream.messages import Estimate, SegmentCounts, SegmentState
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network
from tests.dispatcher_daemon.service.feeds.conftest import Check
from tests.dispatcher_daemon.service.feeds.states import NOW_NS, any_state, counts, features, state

NAMES = {
    "com": "http://datex2.eu/schema/3/common",
    "loc": "http://datex2.eu/schema/3/locationReferencing",
    "roa": "http://datex2.eu/schema/3/roadTrafficData",
    "sls": "urn:slipstream:datex2:1",
}
WHO = FeedSettings(publisher="Troy & <Co>", country="US")
SEGMENTS = ("avenue_east", "avenue_west")


def documents(
    roads: RoadNetwork,
    states: Sequence[SegmentState],
    rsus: dict[str, tuple[str, ...]] | None = None,
    counted: Sequence[SegmentCounts] = (),
) -> tuple[bytes, bytes]:
    """The site table and the measured data of some states and counts."""
    sites = find_sites(roads, watched_pairs(rsus, states, ()))
    measured = measurements(sites, states, roads, NOW_NS, counts=counted)
    return site_table(sites, WHO, NOW_NS), measured_data(measured, WHO, NOW_NS)


def sites_of(document: bytes) -> dict[str, etree._Element]:
    """The measurements by site."""
    found = etree.fromstring(document).findall("roa:siteMeasurements", NAMES)
    return {each.find("roa:measurementSiteReference", NAMES).get("id"): each for each in found}


def check_extensions(document: bytes) -> None:
    """Each extension is as our own schema says."""
    schema = etree.XMLSchema(etree.parse(str(EXTENSION_SCHEMA)))
    found = etree.fromstring(document).findall(".//sls:segmentState", NAMES)
    assert found
    for element in found:
        schema.assertValid(etree.fromstring(etree.tostring(element)))


def test_a_measured_speed_has_its_error_its_spread_and_its_vehicles(roads: RoadNetwork) -> None:
    """In the units of the standard; flow is density times speed."""
    _, document = documents(roads, [state(measured=features())])
    site = sites_of(document)["rsu-1/avenue_east"]
    speed = site.find(".//roa:averageVehicleSpeed", NAMES)
    assert float(speed.findtext("com:speed", namespaces=NAMES)) == pytest.approx(45.0)
    assert float(speed.get("accuracy")) == pytest.approx(2.0)
    assert float(speed.get("standardDeviation")) == pytest.approx(3.6)
    assert speed.get("numberOfInputValuesUsed") == "9"
    assert site.findtext(".//com:vehicleFlowRate", namespaces=NAMES) == "900"
    assert site.findtext(".//roa:densityOfVehicles", namespaces=NAMES) == "20"
    assert site.findtext(".//roa:averageDistanceGap/com:distance", namespaces=NAMES) == "22.5"
    assert site.findtext(".//com:startOfPeriod", namespaces=NAMES) == "2027-01-15T07:59:49.123Z"
    assert site.findtext(".//roa:timeValue", namespaces=NAMES) == "2027-01-15T07:59:59.123Z"
    extension = site.find(".//sls:segmentState", NAMES)
    assert extension.findtext("sls:stability", namespaces=NAMES) == "stable"
    assert extension.find("sls:reason", NAMES) is None
    cv = extension.find("sls:speedCv", NAMES)
    assert float(cv.text) == pytest.approx(0.08)
    assert float(cv.get("standardError")) == pytest.approx(0.00816, abs=1e-5)
    check_extensions(document)


def indexed(site: etree._Element) -> dict[str, etree._Element]:
    """The quantities of a site by their index."""
    return {each.get("index"): each for each in site.findall("roa:physicalQuantity", NAMES)}


def test_fresh_counts_are_the_flow_by_class_with_its_accuracy_and_its_own_time(
    roads: RoadNetwork,
) -> None:
    """In place of density times speed; the table says of which vehicles each index is."""
    older = counts(quarters_ago=1, watched_s=900.0)
    table, document = documents(roads, [state(measured=features())], None, [counts(), older])
    found = indexed(sites_of(document)["rsu-1/avenue_east"])
    flows = {
        index: int(quantity.findtext(".//com:vehicleFlowRate", namespaces=NAMES))
        for index, quantity in found.items()
        if quantity.find(".//roa:vehicleFlow", NAMES) is not None
    }
    assert flows == {"2": 720, "5": 600, "6": 96, "7": 24, "8": 0}
    flow = found["2"].find(".//roa:vehicleFlow", NAMES)
    # 300 of 900 s were not watched: a third of 120 vehicles in the variance.
    assert float(flow.get("accuracy")) == pytest.approx(100 * (9 + 40) ** 0.5 / 120)
    assert flow.get("numberOfInputValuesUsed") == "120"
    assert found["8"].find(".//roa:vehicleFlow", NAMES).get("accuracy") is None
    period = found["5"].find(".//roa:measurementOrCalculationTime/roa:period", NAMES)
    assert [each.text for each in period] == [
        "2027-01-15T07:45:00.000Z",
        "2027-01-15T08:00:00.000Z",
    ]
    speed = found["9"]
    assert speed.findtext(".//roa:averageVehicleSpeed/com:speed", namespaces=NAMES) == "43.2"
    assert speed.findtext(".//com:percentage", namespaces=NAMES) == "85"
    v85 = speed.find(".//roa:speedPercentile/roa:speedPercentile", NAMES)
    assert v85.findtext("com:speed", namespaces=NAMES) == "50.4"
    assert float(v85.get("accuracy")) == pytest.approx(1.5)
    (site,) = etree.fromstring(table).iter(f"{{{NAMES['roa']}}}measurementSite")
    kinds = [each.text for each in site.iter(f"{{{NAMES['com']}}}vehicleType")]
    assert kinds == ["carOrLightVehicle", "lorry", "bus", "motorcycle"]


@pytest.mark.parametrize(
    "counted",
    [
        counts(quarters_ago=2),
        counts(quarters_ago=-2),
        counts(watched_s=59.0),
        counts("avenue_west"),
        counts(rsu="rsu-2"),
    ],
    ids=["old", "ahead", "not watched", "another road's", "another unit's"],
)
def test_without_fresh_counts_the_flow_is_density_times_speed(
    roads: RoadNetwork, counted: SegmentCounts
) -> None:
    """As before there were any."""
    told, plain = (
        documents(roads, [state(measured=features())], {"rsu-1": ("avenue_east",)}, some)[1]
        for some in ((counted,), ())
    )
    assert told == plain
    assert (
        sites_of(plain)["rsu-1/avenue_east"].findtext(".//com:vehicleFlowRate", namespaces=NAMES)
        == "900"
    )


def test_counts_stay_where_the_window_is_unknown(roads: RoadNetwork) -> None:
    """They are of another time; a fault of the camera has begun since."""
    faulty = state(y_e=None, reason="dark")
    _, document = documents(roads, [faulty], None, [counts()])
    found = indexed(sites_of(document)["rsu-1/avenue_east"])
    assert found["2"].findtext(".//com:vehicleFlowRate", namespaces=NAMES) == "720"
    assert found["1"].find(".//roa:physicalQuantityFault", NAMES) is not None


@pytest.mark.parametrize(
    ("given_state", "reason", "fault"),
    [
        (state(y_e=None, reason="frozen"), "frozen", "noDataValuesAvailable"),
        (state(measured=features(), age_s=6.0), "stale", "noDataValuesAvailable"),
        (state(measured=features(), age_s=-2.0), "future", "noDataValuesAvailable"),
        (
            state(y_e=None, reason="implausible", measured=features()),
            "implausible",
            "spuriousUnreliableDataValues",
        ),
        (
            state(y_e=None, reason="window_not_covered", measured=features()),
            "window_not_covered",
            "intermittentDataValues",
        ),
        (None, "no_state", "noDataValuesAvailable"),
        (state(measured=features(speed_mps=69.0)), "no_state", "noDataValuesAvailable"),
    ],
    ids=["fault", "stale", "future", "implausible", "not covered", "no state", "impossible"],
)
def test_unknown_stays_unknown(
    roads: RoadNetwork, given_state: SegmentState | None, reason: str, fault: str
) -> None:
    """It has the reason and no figure, whatever the state held."""
    states = [] if given_state is None else [given_state]
    _, document = documents(roads, states, {"rsu-1": ("avenue_east",)})
    site = sites_of(document)["rsu-1/avenue_east"]
    assert site.findall(".//roa:basicData", NAMES) == []
    faults = site.findall(".//roa:physicalQuantityFault", NAMES)
    assert len(faults) == 4
    assert {f.findtext("roa:physicalQuantityFaultType", namespaces=NAMES) for f in faults} == {
        fault
    }
    assert {f.findtext(".//com:value", namespaces=NAMES) for f in faults} == {reason}
    extension = site.find(".//sls:segmentState", NAMES)
    assert extension.findtext("sls:stability", namespaces=NAMES) == "unknown"
    assert extension.findtext("sls:reason", namespaces=NAMES) == reason
    assert extension.find("sls:meanSpeedMps", NAMES) is None
    check_extensions(document)


def test_an_unknown_flag_takes_no_sound_speed_away(roads: RoadNetwork) -> None:
    """Too few vehicles for a flag still have a speed, with its error."""
    few = state(y_e=None, reason="too_few_vehicles", measured=features(gap_m=None))
    _, document = documents(roads, [few])
    site = sites_of(document)["rsu-1/avenue_east"]
    assert site.findtext(".//com:speed", namespaces=NAMES) == "45"
    assert site.findtext(".//sls:stability", namespaces=NAMES) == "unknown"
    assert len(site.findall("roa:physicalQuantity", NAMES)) == 3


def test_an_error_of_next_to_nothing_is_no_percentage(roads: RoadNetwork) -> None:
    """It would be infinite, which no schema takes; the extension has the error itself."""
    nearly_empty = msgspec.structs.replace(
        features(), density_veh_per_m=Estimate(value=1e-308, standard_error=1.0)
    )
    _, document = documents(roads, [state(measured=nearly_empty)])
    site = sites_of(document)["rsu-1/avenue_east"]
    assert site.find(".//roa:density", NAMES).get("accuracy") is None
    assert site.find(".//sls:densityVehPerM", NAMES).get("standardError") == "1.0"


def test_a_site_lies_where_its_road_lies(roads: RoadNetwork) -> None:
    """Latitude first, in driving direction; its road has the name that the network gives it."""
    table, _ = documents(roads, [], {"rsu-1": SEGMENTS})
    found = {
        site.get("id"): site
        for site in etree.fromstring(table).iter(f"{{{NAMES['roa']}}}measurementSite")
    }
    for name in SEGMENTS:
        site = found[f"rsu-1/{name}"]
        numbers = list(map(float, site.findtext(".//loc:posList", namespaces=NAMES).split()))
        places = [
            roads.projection.place_m(*numbers[i : i + 2])  # type: ignore[union-attr]
            for i in range(0, len(numbers), 2)
        ]
        for place, point in zip(places, roads.segments[name].shape, strict=True):
            assert place == pytest.approx(point, abs=0.02)
        assert site.findtext(".//loc:externalLocationCode", namespaces=NAMES) == name


def test_a_table_has_another_version_when_a_site_is_another(roads: RoadNetwork) -> None:
    """The measured data name that version; the same sites have the same one at any time."""

    def version(document: bytes, tag: str) -> str:
        return str(next(etree.fromstring(document).iter(f"{{{NAMES['roa']}}}{tag}")).get("version"))

    table, data = documents(roads, [], {"rsu-1": SEGMENTS})
    again, _ = documents(roads, [state(measured=features())], {"rsu-1": SEGMENTS})
    fewer, _ = documents(roads, [], {"rsu-1": SEGMENTS[:1]})
    first = version(table, "measurementSiteTable")
    assert version(data, "measurementSiteTableReference") == first
    assert version(again, "measurementSiteTable") == first
    assert version(fewer, "measurementSiteTable") != first


def test_a_network_without_a_place_on_the_earth_is_refused() -> None:
    """In one line that says what to do."""
    with pytest.raises(InputError, match=r"demo: .*latitude and longitude.*netconvert"):
        find_sites(load_network("demo"), [("rsu-1", "avenue_east")])


def test_no_site_is_no_publication(roads: RoadNetwork) -> None:
    """An empty one would break the schema."""
    with pytest.raises(InputError, match="no RSU is known yet"):
        documents(roads, [])


@pytest.mark.slow
def test_a_wrong_projection_is_refused(roads: RoadNetwork) -> None:
    """Also one that leads off the earth."""
    assert roads.projection is not None
    for changed in (
        replace(roads.projection, parameter="nonsense"),
        replace(roads.projection, offset_m=(1e12, 1e12)),
    ):
        with pytest.raises(InputError, match="avenue_east"):
            find_sites(replace(roads, projection=changed), [("rsu-1", "avenue_east")])


FEW = settings(max_examples=20, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
@FEW
@given(states=st.lists(any_state(SEGMENTS), min_size=1, max_size=4))
def test_any_states_give_publications_of_the_right_form(
    roads: RoadNetwork, states: list[SegmentState]
) -> None:
    """Well-formed, every site once in both, and a figure only where y_e or its reason allows it."""
    rsus = {each.rsu: SEGMENTS for each in states}
    table, data = documents(roads, states, rsus)
    ids = [e.get("id") for e in etree.fromstring(table).iter(f"{{{NAMES['roa']}}}measurementSite")]
    assert ids == list(sites_of(data))
    assert len(set(ids)) == len(rsus) * len(SEGMENTS)
    check_extensions(data)
    for site in sites_of(data).values():
        values = [float(speed.text) for speed in site.iterfind(".//com:speed", NAMES)]
        assert all(0 <= value <= 70 * 3.6 for value in values)
        assert bool(values) != bool(site.findall(".//roa:physicalQuantityFault", NAMES))


@FEW
@given(states=st.lists(any_state(SEGMENTS), min_size=1, max_size=4))
def test_any_states_give_publications_that_the_official_schemas_accept(
    roads: RoadNetwork, official_datex2: Check, states: list[SegmentState]
) -> None:
    """The table and the data, with the extension in them."""
    rsus = {each.rsu: SEGMENTS for each in states}
    counted = [counts(segment, rsu=rsu) for rsu in rsus for segment in SEGMENTS]
    for document in documents(roads, states, rsus, counted):
        official_datex2(document)


def test_the_schema_of_the_extension_is_installed_with_the_program() -> None:
    """Consumers get it from there."""
    assert Path(str(EXTENSION_SCHEMA)).is_file()
