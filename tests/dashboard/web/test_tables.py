"""The page's tables from moment to moment."""

from __future__ import annotations

import random
from dataclasses import replace

import msgspec
import pytest

from dashboard.live import LiveData, Snapshot
from dashboard.view.places import Places
from dashboard.web.hub import HubPart, event
from dashboard.web.tables.fleet_file import make_scene
from dashboard.web.tables.rows import Scene
from dashboard.web.tables.tables import PageTables
from dispatcher_daemon.fleet import fleet_from
from slipstream.config import read_data
from slipstream.errors import InputError
from slipstream.messages import (
    Alarm,
    Alarms,
    RsuHealth,
    SilentVehicle,
    StoppedVehicle,
    StoppedVehicles,
    Unserved,
    VehiclePosition,
)
from slipstream.orders import OrderRecord
from slipstream.roads import Segment, build_network
from slipstream.roads.projection import Projection

from .. import city as of

S = 1_000_000_000


@pytest.fixture
def tables(world):
    """Of the demo network."""
    return PageTables(Scene(Places(world.network)), stale_after_s=5.0)


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


@pytest.mark.parametrize("seed", range(2))
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
        anew = PageTables(tables._scene, stale_after_s=5.0)
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
    assert (row["source"], row["state"], row["road"]) == ("planned", "planned", "avenue_east")


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
    tables = PageTables(scene, stale_after_s=5.0)
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


@pytest.mark.slow
def test_a_second_of_a_city_is_a_few_kilobytes(world, now_ns):
    """200 vans that drive and 600 roads whose speeds change by little: what changed, packed."""
    network = of.grid_city()
    tables = PageTables(Scene(Places(network)), stale_after_s=5.0)
    snapshot = of.snapshot(world, network, now_ns)
    tables.update(snapshot, now_ns)
    later_ns = now_ns + S
    states = {
        key: msgspec.structs.replace(state, time_ns=later_ns)
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
    assert len(HubPart(event("delta", delta)).gzip) < 8000


def test_a_cycle_keeps_the_number_of_its_unserved_stops(world, now_ns):
    """Also once there is a later one; a cycle that leaves orders without a plan is not green."""
    live = LiveData(lambda: now_ns)
    unserved = tuple(Unserved(stop=f"s{n}", reason="no vehicle is free") for n in range(3))
    first = world.cycle(1, now_ns).model_copy(update={"unserved": unserved})
    live.add_history((first, world.cycle(2, now_ns + S)), ())
    tables = PageTables(Scene(Places(world.network)), stale_after_s=5.0)
    tables.update(live.snapshot(), now_ns + S)
    told = [(row["unserved"], row["level"]) for row in tables.moment["cycles"].values()]
    assert told == [(3, "warn"), (0, "ok")]


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
    assert levels == ["idle", "ok"]
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


def _position(van, time_ns, **changes):
    fields = {
        "vehicle": van,
        "time_ns": time_ns,
        "segment": "avenue_east",
        "share": 0.5,
        "speed_mps": 10.0,
        "cycle": 3,
        "leg": 0,
        "on_road": True,
    }
    return VehiclePosition(**(fields | changes))


def _order(name, van, now_ns, **changes):
    fields = {
        "order": name,
        "node": "mill",
        "service_s": 60.0,
        "demand": 1,
        "earliest_ns": None,
        "latest_ns": None,
        "state": "under_way",
        "since_ns": now_ns,
        "reason": "",
        "vehicle": van,
        "cycle": 3,
    }
    return OrderRecord(**(fields | changes))


def test_a_silent_van_stays_where_it_was_heard_last_and_is_red(tables, world, now_ns):
    """Whatever later cycles leave out: it has orders, and nobody knows of it."""
    snapshot = _snapshot(
        world,
        now_ns,
        positions={van: _position(van, now_ns) for van in ("van-a", "van-b")},
        orders=(_order("o-1", "van-a", now_ns),),
    )
    tables.update(snapshot, now_ns)
    before = tables.moment["vehicles"]["van-a"]
    assert (before["state"], before["level"], before["seen"]) == ("driving", "ok", None)
    late_ns = now_ns + 210 * S
    later = replace(
        snapshot,
        positions={**snapshot.positions, "van-b": _position("van-b", late_ns)},
        cycles=(world.cycle(3, now_ns), world.cycle(4, late_ns - S)),
        dispatcher=world.dispatcher(late_ns),
    )
    tables.update(later, late_ns)
    row = tables.moment["vehicles"]["van-a"]
    assert (row["state"], row["level"], row["source"]) == ("silent", "bad", "last")
    assert (row["x"], row["y"], row["seen"]) == (before["x"], before["y"], now_ns // 10**6)
    assert "vehicle/van-a" in [item["subject"] for item in tables.moment["status"]["items"]]
    order = tables.moment["orders"]["o-1"]
    assert (order["level"], order["silent_since"]) == ("bad", now_ns // 10**6)


def test_a_van_that_only_the_dispatcher_heard_is_silent_not_unheard(tables, world, now_ns):
    """A page that is started when the fleet is silent already: its place is the dispatcher's."""
    told = SilentVehicle(
        vehicle="van-a", heard_ns=now_ns - 60 * S, segment="avenue_east", share=0.5, orders=3
    )
    dispatcher = world.dispatcher(now_ns).model_copy(update={"silent": (told,)})
    tables.update(_snapshot(world, now_ns, dispatcher=dispatcher), now_ns)
    row = tables.moment["vehicles"]["van-a"]
    assert (row["state"], row["level"], row["road"]) == ("silent", "bad", "avenue_east")
    assert (row["source"], row["seen"]) == ("last", (now_ns - 60 * S) // 10**6)


def test_a_fleet_that_falls_silent_is_one_trouble(tables, world, now_ns):
    """Before those of its vehicles; a vehicle that was off duty is none."""
    positions = {van: _position(van, now_ns) for van in ("van-a", "van-b")}
    positions["van-c"] = _position("van-c", now_ns, cycle=None, leg=None, on_road=False)
    snapshot = _snapshot(world, now_ns, positions=positions)
    at_ns = now_ns + 20 * S
    heard = replace(
        snapshot,
        dispatcher=world.dispatcher(at_ns),
        rsus={"rsu-avenue_east": world.health("avenue_east", at_ns)},
    )
    tables.update(heard, at_ns)
    told = [(one["subject"], one["level"]) for one in tables.moment["status"]["items"]]
    vans = [("vehicle/van-a", "bad"), ("vehicle/van-b", "bad")]
    assert told == [("fleet", "bad"), *vans]
    off_duty = tables.moment["vehicles"]["van-c"]
    assert (off_duty["state"], off_duty["level"]) == ("silent", "idle")


def test_a_van_that_was_never_heard_is_planned_not_driving(tables, world, now_ns):
    """Neither green, nor late before its time; its plan says where it should be."""
    dispatcher = world.dispatcher(now_ns + 20 * S)
    tables.update(_snapshot(world, now_ns, dispatcher=dispatcher), now_ns + 20 * S)
    row = tables.moment["vehicles"]["van-a"]
    assert (row["state"], row["source"], row["level"]) == ("planned", "planned", "idle")
    assert row["text"].startswith("by plan: ")
    assert row["text"].endswith(", never heard")


def test_a_van_that_is_heard_without_its_plan_does_not_drive_it(tables, world, now_ns):
    """It stands at its depot, and the plan's departure goes by."""
    free = _position("van-a", now_ns + 60 * S, cycle=None, leg=None, on_road=False, speed_mps=0.0)
    tables.update(_snapshot(world, now_ns, positions={"van-a": free}), now_ns + 60 * S)
    row = tables.moment["vehicles"]["van-a"]
    assert (row["state"], row["text"]) == ("depot", "has not taken its plan of cycle #3")
    assert (row["source"], row["road"], row["delay_s"]) == ("reported", "avenue_east", 50.0)


def test_orders_are_judged_by_the_clock(tables, world, now_ns):
    """Not green past arrival or window; the vehicle's delay moves the arrival; served stays so."""
    plan = world.plan("van-a", 3, now_ns)
    eta_ns, part = plan.stops[0].arrival_ns, plan.segments[1]
    name, closes_ns = plan.stops[0].stop, eta_ns + 300 * S

    def look(at_ns, **changes):
        told = {"segment": part.segment, "leg": part.leg}
        order = _order(name, "van-a", now_ns, **({"latest_ns": closes_ns} | changes))
        snapshot = _snapshot(
            world,
            now_ns,
            positions={"van-a": _position("van-a", at_ns, **told)},
            dispatcher=world.dispatcher(at_ns),
            orders=(order,),
        )
        tables.update(snapshot, at_ns)
        return tables.moment["orders"][name]

    half_ns = (part.entry_ns + part.exit_ns) // 2
    on_time = look(half_ns)
    assert (on_time["level"], on_time["eta"]) == ("ok", round(eta_ns / 1e6))
    assert look(half_ns + 40 * S)["eta"] == round(eta_ns / 1e6) + 40_000
    missed = look(closes_ns + 125 * S)
    assert (missed["level"], missed["late_since"]) == ("bad", round(closes_ns / 1e6))
    assert missed["late_s"] >= 120
    open_one = look(closes_ns + 125 * S, state="open", vehicle=None, cycle=None)
    assert (open_one["level"], open_one["late_since"]) == ("bad", round(closes_ns / 1e6))
    served = look(closes_ns + 125 * S, state="served", since_ns=closes_ns - S)
    assert (served["level"], served["late_since"], served["late_s"]) == ("ok", None, 0)


def test_the_row_of_an_order_that_has_ended_stays_the_same_object(tables, world, now_ns):
    """Whatever its vehicle does next: a day's rows are not made anew with each plan."""
    carried = _order("c1", "van-a", now_ns)
    ended = replace(carried, order="c2", state="served")
    seen = []
    for cycle in (3, 4):
        plans = {"van-a": world.plan("van-a", cycle, now_ns + cycle * S)}
        snapshot = _snapshot(world, now_ns, plans=plans, orders=(carried, ended))
        tables.update(snapshot, now_ns)
        seen.append(tables.moment["orders"])
    assert seen[0]["c2"] is seen[1]["c2"]
    assert seen[0]["c1"] is not seen[1]["c1"]


def test_an_order_whose_arrival_has_passed_is_late(tables, world, now_ns):
    """Also one of a vehicle that was never heard, and one without a window."""
    plan = world.plan("van-a", 3, now_ns)
    stop = plan.stops[0]
    order = _order(stop.stop, "van-a", now_ns)
    snapshot = _snapshot(world, now_ns, orders=(order,))
    tables.update(snapshot, stop.arrival_ns - S)
    assert tables.moment["orders"][stop.stop]["level"] == "idle"
    tables.update(snapshot, stop.arrival_ns + 61 * S)
    row = tables.moment["orders"][stop.stop]
    assert (row["level"], row["late_since"]) == ("warn", round(stop.arrival_ns / 1e6))


def test_nothing_is_green_while_nobody_plans(tables, world, now_ns):
    """A vehicle that reports where it is, behind a silent dispatcher; units behind a dead bus."""
    vans = ("van-a", "van-b")
    plans = {van: world.plan(van, 3, now_ns) for van in vans}
    positions = {van: _position(van, now_ns) for van in vans}
    known = {"positions": positions, "followed": plans, "plans": plans}
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
    tables = PageTables(Scene(Places(world.network)), stale_after_s=5.0, rsus=rsus)

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
