"""The feeds over HTTP: whom they are given, and only when they have changed."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest
from lxml import etree

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.feeds import EXTENSION_SCHEMA
from dispatcher_daemon.service.feeds.publisher import Feeds
from dispatcher_daemon.service.feeds.sites import MAX_RSUS_PER_SEGMENT
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.messages import RsuHealth, SegmentState, rsu_health_key
from tests.dispatcher_daemon.service.api.conftest import Api
from tests.dispatcher_daemon.service.feeds.conftest import TROY
from tests.dispatcher_daemon.service.feeds.states import NOW_NS, features, health, state

SITES, DATA, DEVICES = "/v1/feeds/datex2/sites", "/v1/feeds/datex2/measured", "/v1/feeds/wzdx"


@dataclass
class World:
    """What a dispatcher with roads in Troy has heard."""

    feeds: Feeds
    states: list[SegmentState]
    healths: dict[str, tuple[int, RsuHealth]]
    now_ns: int = NOW_NS

    def tell(self, rsu: str, **changed: object) -> None:
        """An RSU's health arrives."""
        message = health(rsu, **changed)  # type: ignore[arg-type]
        self.healths[rsu] = self.now_ns, message


@pytest.fixture
def world(demo: RoutingProblem) -> World:
    """Of two listed RSUs."""
    settings = DispatcherSettings(rsus={"rsu-1": ("avenue_east",), "rsu-2": ("avenue_west",)})
    states: list[SegmentState] = [state(measured=features())]
    roads = replace(demo.network, projection=TROY)
    healths: dict[str, tuple[int, RsuHealth]] = {}
    feeds = Feeds(roads, settings, lambda: tuple(states), lambda: healths, lambda: made.now_ns)
    made = World(feeds, states, healths)
    return made


def test_a_reader_gets_all_three(serve: Callable[..., Api], world: World) -> None:
    """Nobody else does; the data name the table, the devices have the status that RSUs told."""
    world.tell("rsu-1")
    world.tell("rsu-2", fault="dark")
    world.tell("rsu-9")
    api = serve(tokens=True, feeds=world.feeds)
    for path in (SITES, DATA, DEVICES):
        assert [api.get(path, who).status for who in (None, "orderer", "reader")] == [401, 403, 200]
    table = etree.fromstring(api.get(SITES, "reader").body)
    data = etree.fromstring(api.get(DATA, "reader").body)
    version = {e.get("version") for e in table.iter("{*}measurementSiteTable")}
    assert version == {e.get("version") for e in data.iter("{*}measurementSiteTableReference")}
    answer = api.get(DEVICES, "reader")
    assert answer.headers["content-type"] == "application/geo+json"
    status = {
        feature["id"]: feature["properties"]["core_details"]["device_status"]
        for feature in answer.json["features"]
    }
    assert status == {"rsu-1/avenue_east": "ok", "rsu-2/avenue_west": "error"}
    extension = api.get("/v1/feeds/datex2/extension.xsd", "reader").body
    assert extension == EXTENSION_SCHEMA.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("path", [SITES, DATA, DEVICES])
def test_what_has_not_changed_is_not_sent_again(
    serve: Callable[..., Api], world: World, path: str
) -> None:
    """By tag or by date; packed for those that take it."""
    api = serve(feeds=world.feeds)
    first = api.get(path)
    assert first.headers["cache-control"] == "private, no-cache"
    for sent in (
        {"If-None-Match": f'"other", {first.headers["etag"]}'},
        {"If-Modified-Since": first.headers["last-modified"]},
    ):
        again = api.ask("GET", path, headers=sent)
        assert (again.status, again.body) == (304, b"")
    for sent in (
        {"If-None-Match": '"other"', "If-Modified-Since": first.headers["last-modified"]},
        {"If-Modified-Since": "Fri, 15 Jan 2027 07:00:00 GMT"},
        {"If-Modified-Since": "Fri, 15 Jan 99999999999999999999 07:00:00 GMT"},
        {"If-Modified-Since": "nonsense"},
    ):
        assert api.ask("GET", path, headers=sent).status == 200
    packed = api.ask("GET", path, headers={"Accept-Encoding": "br, gzip"})
    assert packed.headers["content-encoding"] == "gzip"
    assert gzip.decompress(packed.body) == first.body


def test_the_table_stays_until_the_sites_change(demo: RoutingProblem) -> None:
    """Where no RSU is listed, one that is heard of is a further site."""
    told: list[SegmentState] = [state(measured=features())]
    now_ns = [NOW_NS]
    roads = replace(demo.network, projection=TROY)
    feeds = Feeds(roads, DispatcherSettings(), lambda: tuple(told), dict, lambda: now_ns[0])
    first = feeds.sites()
    now_ns[0] += 3600 * 10**9
    assert feeds.sites() is first
    told.append(state("avenue_west", measured=features()))
    assert feeds.sites().digest != first.digest


def test_a_document_of_states_is_not_made_at_every_request(world: World) -> None:
    """However many ask, the city's roads are not written down more than once a second."""
    first = world.feeds.measured()
    world.states.append(state("avenue_west", rsu="rsu-2", measured=features()))
    assert world.feeds.measured() is first


def test_a_network_without_latitude_has_no_feed(serve: Callable[..., Api]) -> None:
    """The caller is told what its operator has to do."""
    api = serve()
    told = health()
    api.dispatcher.receiver.on_health(rsu_health_key(told.rsu), told.to_bytes())
    for path in (SITES, DATA, DEVICES):
        answer = api.get(path)
        assert answer.status == 404
        assert "latitude" in answer.json["detail"]
        assert "netconvert" in answer.json["mend"]


def test_unlisted_rsus_are_bounded_and_forgotten(demo: RoutingProblem) -> None:
    """So many a segment, and none that has long been silent."""
    now_ns = [NOW_NS]
    roads = replace(demo.network, projection=TROY)
    names = [f"rsu-{number}" for number in range(MAX_RSUS_PER_SEGMENT + 5)]
    healths = {rsu: (NOW_NS, health(rsu)) for rsu in names}
    feeds = Feeds(roads, DispatcherSettings(), lambda: (), lambda: healths, lambda: now_ns[0])
    assert feeds.sites().body.count(b"<roa:measurementSite ") == MAX_RSUS_PER_SEGMENT
    now_ns[0] += 3600 * 10**9
    healths["rsu-new"] = now_ns[0], health("rsu-new")
    assert feeds.sites().body.count(b"<roa:measurementSite ") == 1
