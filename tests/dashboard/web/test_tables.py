"""The page's tables from moment to moment."""

from __future__ import annotations

import random

import pytest

from dashboard.live import LiveData, Snapshot
from dashboard.view.places import Places
from dashboard.web.fleet_file import make_scene
from dashboard.web.hub import Part, event
from dashboard.web.rows import Scene
from dashboard.web.tables import Limits, Tables
from dispatcher_daemon.fleet import fleet_from
from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream.messages import (
    Alarm,
    Alarms,
    RsuHealth,
    StoppedVehicle,
    StoppedVehicles,
    Unserved,
    VehiclePosition,
)
from slipstream.projection import Projection
from slipstream.roads import Segment, build_network

from .. import city as of

S = 1_000_000_000


@pytest.fixture
def tables(world):
    """Of the demo network."""
    return Tables(Scene(Places(world.network)), Limits(5.0, 4.0))


def _snapshot(world, now_ns, y_e=1, **changes):
    state = world.state("avenue_east", now_ns, y_e=y_e)
    plans = {van: world.plan(van, 3, now_ns) for van in ("van-a", "van-b")}
    known = {
        "states": {(state.segment, state.rsu): state},
        "rsus": {state.rsu: world.health("avenue_east", now_ns)},
        "plans": plans,
        "cycles": (world.cycle(3, now_ns),),
        "dispatcher": world.dispatcher(now_ns),
    }
    return Snapshot(**(known | changes))


def _shared(moment, van):
    return [index for index, together in moment["vehicles"][van]["route"] if together]


def test_a_flag_that_closes_takes_its_platoon_off_at_once(tables, world, now_ns):
    """Before the dispatcher's next cycle: with the first turbulent state, or when it is stale."""
    east = tables._scene.places.index["avenue_east"]
    tables.update(_snapshot(world, now_ns), now_ns)
    assert _shared(tables.moment, "van-a") == _shared(tables.moment, "van-b") == [east]
    assert tables.moment["roads"]["avenue_east"]["gate"] == "open"
    delta = tables.update(_snapshot(world, now_ns + S, y_e=0), now_ns + S)
    assert delta is not None
    assert _shared(tables.moment, "van-a") == []
    told = delta["set"]["roads"]["avenue_east"]
    assert (told["flag"], told["gate"]) == ("turbulent", "closed")
    assert told["gate_why"] == "turbulent traffic now; cycle #3 had opened it"
    back = _snapshot(world, now_ns + 2 * S)
    tables.update(back, now_ns + 2 * S)
    assert _shared(tables.moment, "van-a") == [east]
    tables.update(back, now_ns + 20 * S)
    assert _shared(tables.moment, "van-a") == []
    row = tables.moment["roads"]["avenue_east"]
    assert (row["level"], row["gate"]) == ("warn", "closed")


def test_a_closed_gate_waits_for_the_next_cycle(tables, world, now_ns):
    """Traffic that is stable again does not open it before."""
    state = world.state("avenue_west", now_ns, y_e=1)
    tables.update(_snapshot(world, now_ns, states={(state.segment, state.rsu): state}), now_ns)
    row = tables.moment["roads"]["avenue_west"]
    assert (row["flag"], row["gate"]) == ("stable", "closed")
    assert row["gate_why"] == "turbulent traffic in cycle #3; the next one may open it"


@pytest.mark.parametrize("seed", range(4))
def test_roads_moment_after_moment_are_those_of_one_look(tables, world, now_ns, seed):
    """Whatever comes, and however late: the rows are those that nothing was remembered for."""
    drawn = random.Random(seed)
    roads = ["avenue_east", "avenue_west", *list(world.network.segments)[:4]]
    states, stopped, rsus, since = {}, {}, {}, {}
    cycles, dispatcher = (world.cycle(3, now_ns),), world.dispatcher(now_ns)
    for step in range(120):
        now_ns += drawn.choice((S // 2, S // 2, S, 2 * S, 7 * S))
        for _ in range(drawn.randrange(6)):
            road, rsu = drawn.choice(roads), drawn.choice(("a", "a", "a", "b"))
            y_e = drawn.choice((1, 1, 1, 0, None))
            state = world.state(
                road,
                now_ns + round(drawn.choice((0, 0, -0.3, -4.9, -6, 0.9, 3)) * S),
                y_e,
                "uncertain" if y_e is None else None,
                rsu if road == "avenue_east" else "a",
                drawn.uniform(14.0, 15.0),
            )
            name = (state.segment, state.rsu)
            if name not in states or states[name].y_e != y_e:
                since[name] = state.time_ns
            states[name] = state
        if drawn.random() < 0.1:
            road = drawn.choice(roads)
            vehicle = StoppedVehicle(lane=0, along_m=9.0, since_ns=now_ns - 9 * S, seen_ns=now_ns)
            stopped[road, "a"] = StoppedVehicles(
                rsu="a",
                segment=road,
                time_ns=now_ns,
                vehicles=(vehicle,) if drawn.random() < 0.5 else (),
                y_e=1,
                mean_speed_mps=None,
            )
        if drawn.random() < 0.1:
            health = world.health(drawn.choice(roads), now_ns)
            rsus[health.rsu] = health
        if drawn.random() < 0.1:
            cycles = (*cycles, world.cycle(4 + step, now_ns))
        if drawn.random() < 0.05:
            dispatcher = dispatcher.model_copy(update={"stale_after_s": drawn.choice((2.0, 8.0))})
        snapshot = _snapshot(
            world,
            now_ns,
            states=dict(states),
            stopped=dict(stopped),
            rsus=dict(rsus),
            cycles=cycles,
            dispatcher=dispatcher,
            flag_since=dict(since),
        )
        before = tables.moment["roads"]
        delta = tables.update(snapshot, now_ns)
        told = {} if delta is None else delta["set"].get("roads", {})
        gone = [] if delta is None else delta["del"].get("roads", [])
        followed = {name: row | told.get(name, {}) for name, row in before.items()} | {
            name: row for name, row in told.items() if name not in before
        }
        for name in gone:
            del followed[name]
        anew = Tables(tables._scene, Limits(5.0, 4.0))
        # An outage of the bus is remembered for some seconds.
        anew._down_ns = tables._down_ns
        anew.update(snapshot, now_ns)
        assert tables.moment["roads"] == followed == anew.moment["roads"]
        assert tables.moment["vehicles"] == anew.moment["vehicles"]
        assert tables.moment["status"] == anew.moment["status"]


def test_partners_are_named_where_a_platoon_drives(tables, world, now_ns):
    """Both, each with its place, on the road that they share."""
    plan = world.plan("van-a", 3, now_ns)
    part = next(part for part in plan.segments if part.segment == "avenue_east")
    middle_ns = (part.entry_ns + part.exit_ns) // 2
    state = world.state("avenue_east", middle_ns)
    snapshot = _snapshot(world, now_ns, states={(state.segment, state.rsu): state})
    tables.update(snapshot, middle_ns)
    row = tables.moment["vehicles"]["van-a"]
    assert (row["platoon"], row["place"], row["with"]) == ("east-1", 0, ["van-b"])
    assert (row["source"], row["state"], row["road"]) == ("planned", "driving", "avenue_east")


def test_a_depot_by_place_is_marked_where_the_dispatcher_serves_it(tmp_path):
    """At an end of the nearest road, though another road's junction is nearer."""
    at = {"a": (0.0, 0.0), "b": (900.0, 0.0), "c": (400.0, 60.0), "d": (400.0, 900.0)}
    at = {name: (500_000.0 + x, 5_300_000.0 + y) for name, (x, y) in at.items()}
    roads = [Segment(i + j, i, j, 900.0, 13.9, 1, (at[i], at[j])) for i, j in ("ab", "cd")]
    utm = Projection("+proj=utm +zone=33 +ellps=WGS84 +units=m", (0.0, 0.0))
    network = build_network("roads", roads, at, projection=utm)
    ((lat, lon),) = utm.degrees([(500_350.0, 5_300_010.0)])
    file = tmp_path / "fleet.toml"
    file.write_text(f'[[depots]]\nlat = {lat}\nlon = {lon}\n[[vehicles]]\nid = "v"\n')
    assert fleet_from(read_data(file), network, file, may_lack_stops=True).depots[0].node == "a"
    assert make_scene(network, file, ()).depots == {"depot": "a"}


def test_the_whole_fleet_is_listed_with_its_depots(world, now_ns, tmp_path):
    """Also those that nobody has heard of; another file is one clear line."""
    file = tmp_path / "fleet.toml"
    file.write_text(
        '[[depots]]\nid = "yard"\nnode = "depot"\n'
        '[[vehicles]]\nid = "van-a"\n[[vehicles]]\nid = "van-z"\ncarrier = "north"\n'
    )
    scene = make_scene(world.network, file, ())
    assert scene.depots == {"yard": "depot"}
    tables = Tables(scene, Limits(5.0, 4.0))
    tables.update(_snapshot(world, now_ns), now_ns)
    rows = tables.moment["vehicles"]
    assert sorted(rows) == ["van-a", "van-b", "van-z"]
    unheard = rows["van-z"]
    assert (unheard["state"], unheard["level"], unheard["carrier"]) == ("idle", "idle", "north")
    assert unheard["x"] is None
    file.write_text("depots = 3\n")
    with pytest.raises(InputError, match="depots"):
        make_scene(world.network, file, ())


def test_an_idle_cycle_keeps_the_last_figures(tables, world, now_ns):
    """Its energy is none, or zero."""
    tables.update(_snapshot(world, now_ns), now_ns)
    saved = tables.moment["energy"]["last_cycle"]
    assert saved["saved_kwh"] == pytest.approx(0.071)
    idle = world.cycle(4, now_ns + 30 * S).model_copy(update={"energy": None, "plans": 0})
    cycles = (world.cycle(3, now_ns), idle)
    tables.update(_snapshot(world, now_ns, cycles=cycles), now_ns + S)
    assert tables.moment["energy"]["last_cycle"] == saved


def test_a_second_of_a_city_is_a_few_kilobytes(world, now_ns):
    """200 vans that drive and 600 roads whose speeds change by little: what changed, packed."""
    network = of.grid_city()
    tables = Tables(Scene(Places(network)), Limits(5.0, 4.0))
    snapshot = of.snapshot(world, network, now_ns)
    tables.update(snapshot, now_ns)
    later_ns = now_ns + S
    states = {
        key: state.model_copy(update={"time_ns": later_ns})
        for key, state in snapshot.states.items()
    }
    rsus: dict[str, RsuHealth] = {
        name: health.model_copy(update={"time_ns": later_ns})
        for name, health in snapshot.rsus.items()
    }
    after = of.snapshot(world, network, now_ns)
    moved = Snapshot(
        states=states,
        rsus=rsus,
        plans=snapshot.plans,
        cycles=snapshot.cycles,
        dispatcher=after.dispatcher,
    )
    delta = tables.update(moved, later_ns)
    assert delta is not None
    assert "roads" not in delta["set"]
    assert "rsus" not in delta["set"]
    assert len(delta["set"]["vehicles"]) > 100
    assert all("route" not in row for row in delta["set"]["vehicles"].values())
    assert len(Part(event("delta", delta)).gzip) < 8000


def test_a_cycle_keeps_the_number_of_its_unserved_stops(world, now_ns):
    """Also once there is a later one, of which alone the solvers and gates are kept."""
    live = LiveData(10, lambda: now_ns)
    unserved = tuple(Unserved(stop=f"s{n}", reason="no vehicle is free") for n in range(3))
    first = world.cycle(1, now_ns).model_copy(update={"unserved": unserved})
    live.add_history((first, world.cycle(2, now_ns + S)), ())
    tables = Tables(Scene(Places(world.network)), Limits(5.0, 4.0))
    tables.update(live.snapshot(), now_ns + S)
    assert [row["unserved"] for row in tables.moment["cycles"].values()] == [3, 0]


def _alarm(subject, severity="critical", **more):
    return Alarm(
        id=f"{severity} of {subject}",
        severity=severity,
        kind="x",
        subject=subject,
        since_ns=more.pop("since_ns", 1),
        ended_ns=more.pop("ended_ns", None),
        text=f"what {subject} has",
        mend=None,
        **more,
    )


def test_a_row_is_at_the_level_of_what_is_told_of_it(tables, world, now_ns):
    """Vehicles, roads, RSUs, orders by the dispatcher's alarms; not by those that ended."""
    alarms = (
        _alarm("rsu/rsu-avenue_east", "warning"),
        _alarm("vehicle/van-a"),
        _alarm("road/avenue_east", acknowledged_by="kim", acknowledged_ns=now_ns),
        _alarm("vehicle/van-b", ended_ns=now_ns),
        _alarm("rsu/of-no-row"),
    )
    tables.update(_snapshot(world, now_ns), now_ns)
    before = tables.moment
    levels = [before["vehicles"]["van-a"]["level"], before["rsus"]["rsu-avenue_east"]["level"]]
    assert levels == ["ok", "ok"]
    told = Alarms(time_ns=now_ns, alarms=alarms)
    delta = tables.update(_snapshot(world, now_ns, alarms=told), now_ns)
    assert delta is not None
    assert delta["set"]["vehicles"] == {"van-a": {"level": "bad"}}
    assert delta["set"]["roads"] == {
        "avenue_east": {"level": "warn", "why": "what road/avenue_east has"}
    }
    assert delta["set"]["rsus"] == {
        "rsu-avenue_east": {"level": "warn", "why": "what rsu/rsu-avenue_east has"}
    }
    assert set(tables.moment["rsus"]) == {"rsu-avenue_east"}
    # Without them it is as before, and a road's later changes are told.
    later = now_ns + S
    delta = tables.update(_snapshot(world, later, y_e=0), later)
    assert delta is not None
    assert delta["set"]["roads"]["avenue_east"]["flag"] == "turbulent"
    assert tables.moment["rsus"] == before["rsus"]


def test_nothing_is_green_while_nobody_plans(tables, world, now_ns):
    """A vehicle that reports where it is, behind a silent dispatcher; units behind a dead bus."""
    position = VehiclePosition(
        vehicle="van-a",
        time_ns=now_ns,
        segment="avenue_east",
        share=0.5,
        speed_mps=10.0,
        cycle=3,
        leg=0,
        on_road=True,
    )
    plans = {van: world.plan(van, 3, now_ns) for van in ("van-a", "van-b")}
    known = {"positions": {"van-a": position}, "followed": plans, "plans": plans}
    tables.update(_snapshot(world, now_ns, **known), now_ns)
    assert tables.moment["vehicles"]["van-a"]["source"] == "reported"
    assert {row["level"] for row in tables.moment["vehicles"].values()} == {"ok"}
    silent = world.dispatcher(now_ns - 5 * S)
    tables.update(_snapshot(world, now_ns, **known, dispatcher=silent), now_ns)
    assert {row["level"] for row in tables.moment["vehicles"].values()} == {"warn"}
    assert tables.moment["rsus"]["rsu-avenue_east"]["level"] == "ok"
    tables.update(_snapshot(world, now_ns, **known, connected=False), now_ns)
    assert {row["level"] for row in tables.moment["vehicles"].values()} == {"warn"}
    row = tables.moment["rsus"]["rsu-avenue_east"]
    assert (row["level"], "does not answer" in row["why"]) == ("warn", True)


def test_units_of_the_settings_are_listed_though_they_were_never_heard(world, now_ns):
    """With their roads; named once they had time to start, not while the bus is down."""
    rsus = {"rsu-avenue_east": ("avenue_east",), "rsu-9": ("avenue_west",)}
    tables = Tables(Scene(Places(world.network)), Limits(5.0, 4.0), rsus=rsus)

    def look(after_s, **changes):
        at_ns = now_ns + after_s * S
        tables.update(_snapshot(world, at_ns, **changes), at_ns)
        told = [item["subject"] for item in tables.moment["status"]["items"]]
        return tables.moment["rsus"]["rsu-9"], told

    row, told = look(0)
    assert (row["status"], row["level"], told) == ("not heard yet", "idle", [])
    assert row["x"] is not None
    road = tables.moment["roads"]["avenue_west"]
    assert (road["rsu"], road["flag"], road["level"]) == ("rsu-9", "unknown", "warn")
    row, told = look(11)
    assert (row["status"], row["level"], told) == ("never heard", "bad", ["rsu/rsu-9"])
    assert look(12, connected=False)[1] == ["bus"]
    assert look(13)[1] == []
    assert look(23)[1] == ["rsu/rsu-9"]
    # One that was heard stays in the list for as long as it is silent.
    old = world.health("avenue_east", now_ns)
    look(3 * 86400, rsus={old.rsu: old})
    assert tables.moment["rsus"]["rsu-avenue_east"]["status"] == "silent"


def test_after_an_outage_of_the_bus_senders_have_time_to_come_back(tables, world, now_ns):
    """Whoever is silent still some seconds later is named then."""
    old = world.dispatcher(now_ns)

    def told(after_s, **changes):
        at_ns = now_ns + after_s * S
        tables.update(_snapshot(world, at_ns, dispatcher=old, **changes), at_ns)
        return [item["subject"] for item in tables.moment["status"]["items"]]

    assert told(20, connected=False) == ["bus"]
    assert told(22) == []
    assert told(26) == ["dispatcher"]
