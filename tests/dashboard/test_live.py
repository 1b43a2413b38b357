"""Live data keeps the newest of each kind, in bounded memory, and refuses what does not fit."""

from __future__ import annotations

import msgspec
import pytest

from dashboard import live as live_module
from dashboard.live import LiveData
from slipstream.errors import InputError
from slipstream.messages import (
    CYCLE_KEY,
    DISPATCHER_HEALTH_KEY,
    StoppedVehicle,
    StoppedVehicles,
    Unserved,
    plan_key,
    rsu_health_key,
    state_key,
    stopped_key,
)
from slipstream.roads.admission import refusal
from slipstream.roads.sumo_net import load_network

S = 1_000_000_000


@pytest.fixture
def live(now_ns, monkeypatch) -> LiveData:
    """Live data that keeps three cycles."""
    monkeypatch.setattr(live_module, "HISTORY_CYCLES", 3)
    return LiveData(lambda: now_ns)


def test_each_kind_arrives(live, world, now_ns):
    """Messages under their keys are in the next snapshot."""
    state, health = world.state("avenue_east"), world.health("avenue_east")
    plan, cycle, dispatcher = world.plan("van-a", 7), world.cycle(7), world.dispatcher()
    live.on_state(state_key(state.rsu, state.segment), state.to_bytes())
    live.on_rsu_health(rsu_health_key(health.rsu), health.to_bytes())
    live.on_plan(plan_key("van-a"), plan.to_bytes())
    live.on_cycle(CYCLE_KEY, cycle.to_bytes())
    live.on_dispatcher_health(DISPATCHER_HEALTH_KEY, dispatcher.to_bytes())
    snapshot = live.snapshot()
    assert snapshot.states == {("avenue_east", state.rsu): state}
    assert snapshot.rsus == {health.rsu: health}
    assert snapshot.plans == {"van-a": plan}
    assert snapshot.cycles == (cycle,)
    assert snapshot.dispatcher == dispatcher


def test_stopped_vehicles_arrive_in_order(live, now_ns):
    """A late message does not bring back what has ended; one under another key is refused."""

    def told(time_ns: int) -> StoppedVehicles:
        return StoppedVehicles(
            rsu="r", segment="s", time_ns=time_ns, vehicles=(), y_e=None, mean_speed_mps=None
        )

    for time_ns in (now_ns, now_ns - S):
        live.on_stopped(stopped_key("r", "s"), told(time_ns).to_bytes())
    assert live.snapshot().stopped == {("s", "r"): told(now_ns)}
    with pytest.raises(InputError, match="belongs under"):
        live.on_stopped(stopped_key("r", "other"), told(now_ns).to_bytes())


@pytest.mark.attack
def test_a_state_that_no_gate_would_count_is_not_drawn(world, now_ns):
    """The page admits what the dispatcher admits: a listed RSU's possible figures."""
    rsus = {"rsu-1": ("avenue_east",)}
    network = load_network("demo")
    live = LiveData(lambda: now_ns, lambda state: refusal(state, network, rsus))
    state = world.state("avenue_east")
    for rsu, segment, vehicles in (
        ("rsu-2", "avenue_east", 5),
        ("rsu-1", "avenue_west", 5),
        ("rsu-1", "avenue_east", 10**9),
        ("rsu-1", "nowhere", 5),
    ):
        changes = {"rsu": rsu, "segment": segment, "vehicles": vehicles}
        with pytest.raises(InputError, match="state refused: "):
            live.on_state(
                state_key(rsu, segment), msgspec.structs.replace(state, **changes).to_bytes()
            )
    assert not live.snapshot().states
    honest = msgspec.structs.replace(state, rsu="rsu-1")
    live.on_state(state_key("rsu-1", "avenue_east"), honest.to_bytes())
    assert list(live.snapshot().states) == [("avenue_east", "rsu-1")]


@pytest.mark.attack
def test_stopped_vehicles_are_admitted_as_states_are(now_ns):
    """Not those of an unlisted RSU or segment, nor impossible times, places and speeds."""
    network = load_network("demo")
    rsus = {"rsu-1": ("avenue_east",)}
    live = LiveData(lambda: now_ns, lambda message: refusal(message, network, rsus))
    since_ns = now_ns - 9 * S
    vehicle = StoppedVehicle(lane=1, along_m=40.0, since_ns=since_ns, seen_ns=now_ns - S)
    honest = StoppedVehicles(
        rsu="rsu-1",
        segment="avenue_east",
        time_ns=now_ns,
        vehicles=(vehicle,),
        y_e=1,
        mean_speed_mps=15.0,
    )
    forged = [
        *({"rsu": "rsu-2"}, {"segment": "avenue_west"}, {"segment": "nowhere"}),
        *({"time_ns": now_ns - 2 * S}, {"mean_speed_mps": 1e300}),
        {"vehicles": (vehicle, vehicle.model_copy(update={"seen_ns": since_ns - 1}))},
        {"vehicles": (vehicle.model_copy(update={"along_m": 1e300}),)},
        {"vehicles": (vehicle.model_copy(update={"lane": 10**9}),)},
    ]
    for changes in forged:
        bad = honest.model_copy(update=changes)
        with pytest.raises(InputError, match="refused: "):
            live.on_stopped(stopped_key(bad.rsu, bad.segment), bad.to_bytes())
    assert not live.snapshot().stopped
    live.on_stopped(stopped_key("rsu-1", "avenue_east"), honest.to_bytes())
    assert live.snapshot().stopped == {("avenue_east", "rsu-1"): honest}


def test_late_repairs_do_not_win(live, world, now_ns):
    """A sample older than the one known does not replace it."""
    for offset_s in (0, -5):
        state = world.state("avenue_east", now_ns + offset_s * S)
        live.on_state(state_key(state.rsu, state.segment), state.to_bytes())
    (state,) = live.snapshot().states.values()
    assert state.time_ns == now_ns


def test_only_the_last_cycles_are_kept(live, world, now_ns):
    """History from storage and live reports make one history of bounded length, oldest first."""
    live.add_history([world.cycle(n, now_ns + n * S) for n in (1, 2, 3)], [])
    live.on_cycle(CYCLE_KEY, world.cycle(4, now_ns + 4 * S).to_bytes())
    live.on_cycle(CYCLE_KEY, world.cycle(4, now_ns + 4 * S).to_bytes())
    assert [report.cycle for report in live.snapshot().cycles] == [2, 3, 4]


def test_a_clock_that_was_set_back_does_not_block(live, world, now_ns):
    """What is dated ahead of this clock gives way to what comes, although it is dated earlier."""
    for then_ns in (now_ns + 3600 * S, now_ns):
        state = world.state("avenue_east", then_ns)
        health, plan = world.health("avenue_east", then_ns), world.plan("van-a", 7, then_ns)
        live.on_state(state_key(state.rsu, state.segment), state.to_bytes())
        live.on_rsu_health(rsu_health_key(health.rsu), health.to_bytes())
        live.on_plan(plan_key("van-a"), plan.to_bytes())
    snapshot = live.snapshot()
    assert snapshot.states == {("avenue_east", state.rsu): state}
    assert snapshot.rsus == {health.rsu: health}
    assert snapshot.plans == {"van-a": plan}


@pytest.mark.parametrize(("tolerance_s", "kept_s"), [(4.0, 3), (0.5, 0), (None, 0)])
def test_a_state_is_ahead_by_the_dispatchers_tolerance(live, world, now_ns, tolerance_s, kept_s):
    """A state within the published tolerance is not replaced by an earlier one."""
    health = world.dispatcher(now_ns).model_copy(update={"future_tolerance_s": tolerance_s})
    live.on_dispatcher_health(DISPATCHER_HEALTH_KEY, health.to_bytes())
    for ahead_s in (3, 0):
        state = world.state("avenue_east", now_ns + ahead_s * S)
        live.on_state(state_key(state.rsu, state.segment), state.to_bytes())
    (kept,) = live.snapshot().states.values()
    assert kept.time_ns == now_ns + kept_s * S


def test_the_highest_cycle_is_the_last(live, world, now_ns):
    """After a clock that was ahead is set back, the next cycle is the last one all the same."""
    for number in (1, 2, 3):
        live.on_cycle(CYCLE_KEY, world.cycle(number, now_ns + (3600 + number) * S).to_bytes())
    live.on_cycle(CYCLE_KEY, world.cycle(4, now_ns).to_bytes())
    assert [report.cycle for report in live.snapshot().cycles] == [2, 3, 4]


def test_only_the_last_cycle_is_kept_whole(live, world, now_ns):
    """Older reports keep their energy but not their long lists, and are not taken for others."""
    reports = [
        world.cycle(n, now_ns - (3 - n) * S).model_copy(
            update={"unserved": (Unserved(stop="c1", reason="no way"),)}
        )
        for n in (1, 2)
    ]
    for _ in range(2):
        for report in reports:
            live.on_cycle(CYCLE_KEY, report.to_bytes())
        older, last = live.snapshot().cycles
        assert last == reports[1]
        assert (older.cycle, older.energy) == (1, reports[0].energy)
        assert (older.solvers, older.gates) == ((), ())
        assert len(older.unserved) == 1


def test_orders_that_wait_for_hours_are_kept_once(live, world, now_ns):
    """Each report names them: of older ones their number is kept."""
    waiting = tuple(Unserved(stop=f"c{k}", reason="no vehicle is free") for k in range(50))
    for n in range(1, 4):
        report = world.cycle(n, now_ns - (4 - n) * S).model_copy(update={"unserved": waiting})
        live.on_cycle(CYCLE_KEY, report.to_bytes())
    *older, last = live.snapshot().cycles
    assert last.unserved == waiting
    assert [len(report.unserved) for report in older] == [50, 50]
    assert len({id(one) for report in older for one in report.unserved}) == 1
    known = live.snapshot().cycles
    live.add_history((), ())
    assert all(a is b for a, b in zip(known, live.snapshot().cycles, strict=True))


@pytest.mark.parametrize(
    ("number", "age_s", "left"),
    [(1, 0, [1]), (9, 0, [8, 9]), (10, 0, [8, 9, 10]), (7, 3, [8, 9, 10])],
)
def test_cycles_that_are_counted_anew(live, world, now_ns, number, age_s, left):
    """A lower number that began later replaces those from it on; one that is merely late does not.

    The dispatcher counts anew with another database, or after cycles that it could not store.
    """
    live.add_history([world.cycle(n, now_ns - (11 - n) * S) for n in (8, 9, 10)], [])
    live.on_cycle(CYCLE_KEY, world.cycle(number, now_ns - age_s * S - S // 2).to_bytes())
    assert [report.cycle for report in live.snapshot().cycles] == left


def test_failures_that_no_report_tells_of(live, world, now_ns):
    """The moment when the dispatcher's count of failed cycles rises is kept; a restart is none."""
    for failed, restarts, seen in ((0, 0, None), (2, 0, now_ns), (2, 0, now_ns), (1, 1, now_ns)):
        health = world.dispatcher(now_ns + restarts * S)
        health = health.model_copy(update={"cycles_failed": failed})
        live.on_dispatcher_health(DISPATCHER_HEALTH_KEY, health.to_bytes())
        assert live.snapshot().cycle_failed_ns == seen


def test_memory_is_bounded(live, world, now_ns, monkeypatch):
    """However many names send, only so many are remembered, the last heard of."""
    monkeypatch.setattr(live_module, "MAX_ENTRIES", 5)
    for number in range(20):
        state = world.state("avenue_east", now_ns, rsu=f"rsu-{number}")
        live.on_state(state_key(state.rsu, state.segment), state.to_bytes())
    snapshot = live.snapshot()
    assert [rsu for _, rsu in snapshot.states] == [f"rsu-{number}" for number in range(15, 20)]


def test_messages_under_a_wrong_key_are_refused(live, world):
    """What does not belong under its key, or is no such message, is refused and not kept."""
    state = world.state("avenue_east")
    with pytest.raises(InputError, match="belongs under"):
        live.on_state(state_key("rsu-other", "avenue_east"), state.to_bytes())
    with pytest.raises(InputError, match="not a SegmentState"):
        live.on_state(state_key(state.rsu, state.segment), b'{"hello": 1}')
    with pytest.raises(InputError, match="not a VehiclePlan"):
        live.on_plan(plan_key("van-a"), b"\xff\xfe")
    assert live.snapshot().states == {}
