"""What the page shows follows from the messages and the time, and fails safe."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from dashboard.live import Snapshot
from dashboard.view import labels
from dashboard.view.build import DashboardView, build_view
from dashboard.view.model import LIST_FOR_S, platoon_km
from dashboard.view.progress import planned_part
from dispatcher_daemon.traffic.snapshot import take_snapshot
from slipstream.messages import (
    CAMERA_FAULTS,
    DISPATCHER_HEALTH_KEY,
    DispatcherHealth,
    decode,
)

S = 1_000_000_000


def _view(snapshot: Snapshot, now_ns: int) -> DashboardView:
    return build_view(snapshot, now_ns, 5.0)


def _states(*states):
    return {(state.segment, state.rsu): state for state in states}


def test_a_fresh_state_is_shown_in_kmh(world, now_ns):
    """A fresh stable state is shown as stable, with speed in km/h and CV."""
    state = world.state("avenue_east", now_ns - 2 * S, speed_mps=15.0)
    (road,) = _view(Snapshot(states=_states(state)), now_ns).roads
    assert road.traffic == "stable"
    assert road.speed_kmh == pytest.approx(54.0)
    assert road.cv == pytest.approx(0.05)
    assert road.gate_cycle is None


@pytest.mark.parametrize("age_s", [5.1, 60.0, -1.1])
def test_old_and_future_states_are_unknown(world, now_ns, age_s):
    """A stable state that is too old, or from a clock that is ahead, is shown as unknown."""
    state = world.state("avenue_east", now_ns - round(age_s * S))
    (road,) = _view(Snapshot(states=_states(state)), now_ns).roads
    assert road.traffic == "unknown"
    assert road.speed_kmh is None
    assert road.reason == ("no fresh data" if age_s > 0 else "the camera's clock is ahead")


@pytest.mark.parametrize(
    ("limits", "age_s", "shown"),
    [
        ({"stale_after_s": 2.0}, 3.0, "unknown"),
        ({"stale_after_s": 20.0}, 19.0, "stable"),
        ({"stale_after_s": 20.0}, 21.0, "unknown"),
        ({"future_tolerance_s": 4.0}, -3.0, "stable"),
        ({"future_tolerance_s": 0.0}, -0.5, "unknown"),
        ({}, 4.0, "stable"),
        ({}, 6.0, "unknown"),
        (None, 4.0, "stable"),
        (None, 6.0, "unknown"),
    ],
)
def test_roads_are_judged_by_the_dispatchers_limits(world, now_ns, limits, age_s, shown):
    """The page has the published limits; the default ones with an older dispatcher or none."""
    state = world.state("avenue_east", now_ns - round(age_s * S))
    health = None
    if limits is not None:
        # A dispatcher of the version before sends neither field.
        fields = world.dispatcher(now_ns).model_dump(mode="json", exclude_none=True) | limits
        health = decode(DispatcherHealth, json.dumps(fields).encode(), DISPATCHER_HEALTH_KEY)
    (road,) = _view(Snapshot(states=_states(state), dispatcher=health), now_ns).roads
    assert road.traffic == shown


def test_the_page_agrees_with_the_gates(world, now_ns):
    """With limits of the dispatcher's own, a road is shown as stable where its gate is open."""
    limits = {"stale_after_s": 8.0}
    health = world.dispatcher(now_ns).model_copy(update=limits)
    for age_s in (-3.0, -2.0, 0.0, 4.0, 7.0, 9.0):
        state = world.state("avenue_east", now_ns - round(age_s * S))
        gate = take_snapshot(world.network, (state,), now_ns, **limits).segments["avenue_east"]
        (road,) = _view(Snapshot(states=_states(state), dispatcher=health), now_ns).roads
        assert (road.traffic == "stable") == gate.open


def test_unknown_is_shown_with_its_reason(world, now_ns):
    """A fresh unknown is shown with its reason in plain words and without figures."""
    state = world.state("avenue_east", now_ns, y_e=None)
    (road,) = _view(Snapshot(states=_states(state)), now_ns).roads
    assert (road.traffic, road.reason, road.cv) == ("unknown", "too few vehicles to tell", None)


@pytest.mark.parametrize(
    ("flags", "shown"),
    [((1, 0), "turbulent"), ((1, None), "stable"), ((None, 0), "turbulent")],
)
def test_several_cameras_on_a_road(world, now_ns, flags, shown):
    """Where two RSUs watch a road, turbulence counts before calm, and calm before unknown."""
    states = [
        world.state("avenue_east", now_ns - i, y_e=flag, rsu=f"rsu-{i}")
        for i, flag in enumerate(flags)
    ]
    (road,) = _view(Snapshot(states=_states(*states)), now_ns).roads
    assert road.traffic == shown


def test_a_stale_camera_does_not_count_beside_a_fresh_one(world, now_ns):
    """An old turbulent state is overruled by a fresh stable one of another RSU."""
    old = world.state("avenue_east", now_ns - 20 * S, y_e=0, rsu="rsu-1")
    fresh = world.state("avenue_east", now_ns, y_e=1, rsu="rsu-2")
    (road,) = _view(Snapshot(states=_states(old, fresh)), now_ns).roads
    assert (road.traffic, road.rsu) == ("stable", "rsu-2")


def test_a_watched_road_without_states_is_listed(world, now_ns):
    """A road that an RSU names as its own is shown as unknown before the first state."""
    health = world.health("avenue_east", now_ns)
    (road,) = _view(Snapshot(rsus={health.rsu: health}), now_ns).roads
    assert (road.segment, road.rsu, road.traffic) == ("avenue_east", health.rsu, "unknown")
    assert road.reason == "no data"


def test_gates_of_the_last_cycle(world, now_ns):
    """Each road has its gate in the last cycle, and why it is closed."""
    view = _view(Snapshot(cycles=(world.cycle(3, now_ns),)), now_ns)
    east, west = view.roads
    assert (east.gate_cycle, east.gate_open, east.gate_reason) == (3, True, "")
    assert (west.gate_cycle, west.gate_open, west.gate_reason) == (3, False, "turbulent traffic")


def test_an_unknown_flag_shows_the_rsu_s_reason(world, now_ns):
    """A gate's flag and reason are separate fields."""
    report = world.cycle(3, now_ns)
    changes = {"y_e": None, "reason": "too_few_vehicles"}
    west = report.gates[1].model_copy(update=changes)
    report = report.model_copy(update={"gates": (report.gates[0], west)})
    _, road = _view(Snapshot(cycles=(report,)), now_ns).roads
    assert (road.gate_open, road.gate_reason) == (False, "too few vehicles to tell")


@pytest.mark.parametrize(
    ("status", "age_s", "shown", "level"),
    [
        ("ok", 1.0, "ok", "ok"),
        ("no_signal", 1.0, "no picture", "bad"),
        ("ended", 1.0, "clip ended", "warn"),
        ("ok", 6.0, "silent", "bad"),
        ("ok", -2.0, "clock ahead", "bad"),
    ],
)
def test_rsu_status(world, now_ns, status, age_s, shown, level):
    """An RSU's status is its own word while it is heard of, and "silent" after that."""
    health = world.health("avenue_east", now_ns - round(age_s * S), status)
    (unit,) = _view(Snapshot(rsus={health.rsu: health}), now_ns).rsus
    assert (unit.status, unit.level) == (shown, level)
    assert unit.skipped_share == pytest.approx(9 / 9000)
    assert unit.fps == (None if shown in ("silent", "clock ahead") else 29.97)


@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_a_cameras_fault_is_shown_with_its_label(world, now_ns, fault):
    """The unit's status and its roads say what is wrong, and no road is shown as known."""
    health = world.health("avenue_east", now_ns).model_copy(update={"fault": fault})
    state = world.state("avenue_east", now_ns, y_e=None, reason=fault)
    view = _view(Snapshot(rsus={health.rsu: health}, states=_states(state)), now_ns)
    (unit,), (road,) = view.rsus, view.roads
    assert unit.level == "bad"
    assert unit.status == labels.camera_fault(fault)
    assert road.traffic == "unknown"
    assert "_" not in unit.status + road.reason


def test_units_without_news_for_a_day_are_not_listed(world, now_ns):
    """RSUs, roads and vans not heard of for a day are no longer listed."""
    then_ns = now_ns - round((LIST_FOR_S + 1000) * S)
    health, state = world.health("avenue_east", then_ns), world.state("avenue_east", then_ns)
    plan = world.plan("van-a", 1, then_ns)
    snapshot = Snapshot(
        rsus={health.rsu: health}, states=_states(state), plans={plan.vehicle: plan}
    )
    view = _view(snapshot, now_ns)
    assert (view.rsus, view.roads, view.vehicles) == ((), (), ())


def _of_dispatcher(snapshot: Snapshot, now_ns: int) -> list[tuple[str, str]]:
    """Level and text of what is wrong with the dispatcher, its cycles and its database."""
    troubles = _view(snapshot, now_ns).troubles
    return [(t.level, t.text) for t in troubles if t.subject in ("dispatcher", "database")]


def test_a_dispatcher_without_fresh_health_is_silent(world, now_ns):
    """Silent after four seconds; not heard at all; or with a clock that is ahead."""
    heard = Snapshot(dispatcher=world.dispatcher(now_ns), cycles=(world.cycle(1, now_ns),))
    assert _of_dispatcher(heard, now_ns) == []
    assert _of_dispatcher(heard, now_ns + 5 * S) == [
        ("bad", "The dispatcher is silent: no plans are made")
    ]
    assert "has not been heard" in _of_dispatcher(Snapshot(), now_ns)[0][1]
    ahead = Snapshot(dispatcher=world.dispatcher(now_ns + 40 * S))
    assert "clock is ahead" in _of_dispatcher(ahead, now_ns)[0][1]


def test_a_failed_cycle_is_shown(world, now_ns):
    """While the last cycle failed the dispatcher is in trouble."""
    health = world.dispatcher(now_ns).model_copy(update={"cycles_failed": 1})
    good, bad = world.cycle(1, now_ns - 40 * S), world.cycle(2, now_ns - 10 * S, "failed")
    snapshot = Snapshot(dispatcher=health, cycles=(good, bad))
    assert _of_dispatcher(snapshot, now_ns) == [("bad", "The last cycle failed")]
    after = world.cycle(3, now_ns - 2 * S)
    assert _of_dispatcher(Snapshot(dispatcher=health, cycles=(good, bad, after)), now_ns) == []


@pytest.mark.attack
@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"states_refused": 3}, "The dispatcher has 3 states refused"),
        ({"messages_lost": 1}, "The dispatcher has 1 message lost"),
        (
            {"database_set_aside": "x.db-corrupt-1"},
            "A damaged database was set aside as x.db-corrupt-1",
        ),
    ],
)
def test_what_was_refused_lost_or_set_aside_is_shown(world, now_ns, changes, shown):
    """Somebody floods the bus, or a file was damaged: the page says so."""
    health = world.dispatcher(now_ns).model_copy(update=changes)
    snapshot = Snapshot(dispatcher=health, cycles=(world.cycle(1, now_ns),))
    assert _of_dispatcher(snapshot, now_ns) == [("warn", shown)]


@pytest.mark.parametrize(("ago_s", "failed"), [(5, True), (60, False), (-60, False)])
def test_a_failure_without_a_report(world, now_ns, ago_s, failed):
    """A count of failed cycles that has risen since the last good cycle is trouble too."""
    snapshot = Snapshot(
        dispatcher=world.dispatcher(now_ns),
        cycles=(world.cycle(1, now_ns - 20 * S),),
        cycle_failed_ns=now_ns - ago_s * S,
    )
    assert bool(_of_dispatcher(snapshot, now_ns)) == failed


@pytest.mark.parametrize(
    ("interval_s", "age_s", "overdue"),
    [(30, 89, False), (30, 91, True), (10, 31, True), (200, 590, False), (30, -3600, True)],
)
def test_cycles_that_no_longer_come(world, now_ns, interval_s, age_s, overdue):
    """A dispatcher that is heard of but has had no good cycle for three intervals is in trouble."""
    last_ns = now_ns - age_s * S
    cycles = [world.cycle(4 + n, last_ns - (2 - n) * interval_s * S) for n in range(3)]
    health = world.dispatcher(now_ns).model_copy(update={"started_ns": now_ns - 3600 * S})
    told = _of_dispatcher(Snapshot(dispatcher=health, cycles=tuple(cycles)), now_ns)
    assert told == ([("bad", "Cycles are overdue: none was good of late")] if overdue else [])


def test_a_dispatcher_that_has_just_started(world, now_ns):
    """It is not to blame that the last stored cycle is old."""
    health = world.dispatcher(now_ns).model_copy(update={"started_ns": now_ns - 3 * S})
    snapshot = Snapshot(dispatcher=health, cycles=(world.cycle(1, now_ns - 9000 * S),))
    assert _of_dispatcher(snapshot, now_ns) == []


def test_headline_counts_calm_roads(world, now_ns):
    """The headline counts what is calm now, and waits where nothing has been seen."""
    states = _states(world.state("avenue_east", now_ns), world.state("avenue_west", now_ns, y_e=0))
    assert _view(Snapshot(states=states), now_ns).headline == (
        "Traffic is calm on 1 of 2 watched roads",
        "ok",
    )
    assert "Waiting" in _view(Snapshot(), now_ns).headline[0]


def test_planned_position_follows_the_plan(world, now_ns):
    """A van stands at the depot until it leaves, runs along its segments, and ends at the last."""
    plan = world.plan("van-a", 1, now_ns)
    first, second = plan.segments[:2]
    assert planned_part(plan, now_ns)[1] == (first.segment, 0.0)
    middle_ns = (second.entry_ns + second.exit_ns) // 2
    assert planned_part(plan, middle_ns)[1] == (second.segment, pytest.approx(0.5))
    at_stop_ns = plan.stops[0].arrival_ns + S
    assert planned_part(plan, at_stop_ns)[1] == ("mill_street_east", 1.0)
    assert planned_part(plan, plan.segments[-1].exit_ns + S)[1] == ("depot_road_west", 1.0)
    assert planned_part(plan.model_copy(update={"segments": ()}), now_ns) == (None, None)


@pytest.mark.parametrize(
    ("last", "after_s", "status", "idle"),
    [
        (8, 30, "ok", True),
        (8, 30, "baseline", True),
        (8, 30, "failed", False),
        (7, 0, "ok", False),
        (6, -30, "ok", False),
        (1, 30, "ok", True),
        (8, 3600, "ok", False),
    ],
)
def test_a_van_without_a_plan_in_the_last_cycle_is_idle(world, now_ns, last, after_s, status, idle):
    """A later cycle, also of a new count, voids older plans, unless it failed or is dated ahead."""
    plan = world.plan("van-a", 7, now_ns)
    report = world.cycle(last, now_ns + after_s * S, status)
    at_ns = now_ns + 40 * S
    (van,) = _view(Snapshot(plans={"van-a": plan}, cycles=(report,)), at_ns).vehicles
    assert van.idle == idle
    if idle:
        assert van.progress.text == f"no plan in cycle #{last}, never heard"
        assert (van.route, van.plan.stops, van.position) == ((), (), None)
        assert (van.plan.distance_m, van.plan.energy_kwh) == (0.0, 0.0)
    else:
        assert van.route


def test_a_van_with_an_empty_plan_is_idle_and_comes_last(world, now_ns):
    """A plan without a road and a stop says idle; such vans come after those that drive."""
    empty = world.plan("van-a", 7, now_ns).model_copy(update={"segments": (), "stops": ()})
    plans = {"van-a": empty, "van-b": world.plan("van-b", 7, now_ns)}
    driving, idle = _view(Snapshot(plans=plans), now_ns).vehicles
    assert (driving.vehicle, driving.idle) == ("van-b", False)
    assert (idle.vehicle, idle.progress.text) == ("van-a", "has no plan, never heard")
    assert idle.rgb == labels.VEHICLE_RGB[0]


def test_platooned_distance_of_a_plan(world, now_ns):
    """A van's kilometres in a platoon are those of the segments with a platoon."""
    plan = world.plan("van-a", 1, now_ns)
    assert platoon_km(plan) == pytest.approx(1.996, abs=0.01)


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        (0.04, "0.0 s"),
        (1.2, "1.2 s"),
        (42.0, "42 s"),
        (150.0, "2 min"),
        (7200.0, "2 h"),
        (4e5, "5 days"),
    ],
)
def test_durations(seconds, shown):
    """Durations read at a glance."""
    assert labels.duration(seconds) == shown


def test_states_differ_by_more_than_colour():
    """Each state of traffic has its own sign, and no van has nearly a state's colour."""
    assert len(set(labels.TRAFFIC_SIGN.values())) == 3
    for rgb in labels.VEHICLE_RGB:
        for state in labels.TRAFFIC_RGB.values():
            assert sum((a - b) ** 2 for a, b in zip(rgb, state, strict=True)) > 60**2


PROTANOPIA = (
    (0.152286, 1.052583, -0.204868),
    (0.114503, 0.786281, 0.099216),
    (-0.003882, -0.048116, 1.051998),
)
DEUTERANOPIA = (
    (0.367322, 0.860646, -0.227968),
    (0.280085, 0.672501, 0.047413),
    (-0.011820, 0.042940, 0.968881),
)
"""In linear light; Machado, Oliveira and Fernandes 2009, severity 1."""
XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))


def _page_colours(name):
    """Colours of the operator's page by name, on light and on dark, (2, N, 3)."""
    text = Path("dashboard/web/static/map/map.css").read_text()
    found = re.findall(rf"--{name}: #(..)(..)(..);", text)
    return np.array([[int(part, 16) for part in rgb] for rgb in found]).reshape(2, -1, 3)


def _page_palettes():
    return _page_colours(r"vehicle-\d+")


def _linear(rgb):
    share = rgb / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def test_both_pages_have_the_same_colours():
    """A van on the operator's page is found again in the 3D view."""
    assert _page_palettes()[0].tolist() == [list(rgb) for rgb in labels.VEHICLE_RGB]


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize(
    "seen", [np.eye(3), PROTANOPIA, DEUTERANOPIA], ids=["all", "no-red", "no-green"]
)
def test_vehicles_are_told_apart_without_red_or_green_cones(seen, dark):
    """Twelve colours differ by 20 in CIELAB, also as a dichromat sees them, and from the map."""
    linear = _linear(_page_palettes()[int(dark)])
    xyz = np.clip(linear @ np.transpose(seen), 0, 1) @ np.transpose(XYZ) / (0.9505, 1.0, 1.089)
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    x, y, z = f.T
    lab = np.column_stack((116 * y - 16, 500 * (x - y), 200 * (y - z)))
    apart = np.linalg.norm(lab[:, None] - lab, axis=2)
    assert len(lab) == 12
    assert apart[~np.eye(12, dtype=bool)].min() > 20
    # WCAG 1.4.11: marks have a contrast of 3 to what is behind them; thin lines on dark need more.
    luminance = linear @ XYZ[1] + 0.05
    land = _linear(_page_colours("map-land")[int(dark)]) @ XYZ[1] + 0.05
    assert (luminance / land if dark else land / luminance).min() > (4 if dark else 3)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("state", ["stable", "turbulent", "unknown", "bad"])
def test_no_vehicle_has_nearly_the_colour_of_a_flag_or_a_fault(state, dark):
    """On the operator's map too."""
    flag = _page_colours(f"map-{state}")[int(dark)]
    assert np.linalg.norm(_page_palettes()[int(dark)] - flag, axis=1).min() > 60
