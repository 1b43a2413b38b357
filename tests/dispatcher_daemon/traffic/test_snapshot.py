from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import (
    PERSISTENCE_S,
    GateForecast,
    SegmentTraffic,
    TrafficSnapshot,
    take_snapshot,
)
from slipstream.messages import CAMERA_FAULTS, Gate, SegmentState

State = Callable[..., SegmentState]
SECOND = 1_000_000_000


@pytest.mark.parametrize(
    ("y_e", "age_s", "is_open", "reason"),
    [
        (1, 0.0, True, None),
        (1, 5.0, True, None),
        (1, 5.1, False, "stale"),
        (0, 1.0, False, "turbulent"),
        (0, 60.0, False, "stale"),
        (None, 1.0, False, "uncertain"),
        (1, -0.5, True, None),
        (1, -2.0, False, "future"),
    ],
)
def test_gate_opens_only_for_a_fresh_stable_state(
    demo: RoutingProblem,
    state: State,
    now_ns: int,
    y_e: int | None,
    age_s: float,
    is_open: bool,
    reason: str | None,
) -> None:
    """y_e = 1 within the age limit opens the gate; everything else closes it with its reason."""
    seen = state("avenue_east", y_e, time_ns=now_ns - round(age_s * 1e9))
    snapshot = take_snapshot(demo.network, [seen], now_ns, stale_after_s=5.0)
    traffic = snapshot.segments["avenue_east"]
    assert (traffic.open, traffic.reason) == (is_open, reason)
    (gate,) = snapshot.gates()
    assert (gate.segment, gate.open, gate.reason) == ("avenue_east", is_open, reason)
    assert gate.y_e == (None if reason in ("stale", "future") else y_e)


def test_a_gate_tells_what_it_was_judged_by(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Flag, reason, age and the measured speed, not the one that is planned with."""
    seen = [
        state("avenue_east", 1, time_ns=now_ns - 2 * SECOND, speed_mps=30.0),
        state("avenue_west", 0, time_ns=now_ns - SECOND, speed_mps=7.0),
    ]
    assert take_snapshot(demo.network, seen, now_ns, stale_after_s=5.0).gates() == (
        Gate(segment="avenue_east", y_e=1, reason=None, age_s=2.0, speed_mps=30.0, open=True),
        Gate(
            segment="avenue_west", y_e=0, reason="turbulent", age_s=1.0, speed_mps=7.0, open=False
        ),
    )


def test_what_traffic_does_is_handed_on_as_it_was_measured(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Speed below the planning floor, acceleration and its variance; nothing where not measured."""
    seen = [
        state(
            "avenue_east",
            0,
            speed_mps=0.4,
            mean_acceleration_mps2=-0.3,
            acceleration_variance_m2ps4=0.7,
        ),
        state("avenue_west", None, features=False),
    ]
    segments = take_snapshot(demo.network, seen, now_ns, stale_after_s=5.0).segments
    east, west = segments["avenue_east"], segments["avenue_west"]
    assert (east.y_e, east.speed_mps, east.measured_speed_mps) == (0, 1.0, 0.4)
    assert (east.mean_acceleration_mps2, east.acceleration_variance_m2ps4) == (-0.3, 0.7)
    assert (west.y_e, west.measured_speed_mps) == (None, None)
    assert (west.mean_acceleration_mps2, west.acceleration_variance_m2ps4) == (0.0, 0.0)
    spread = state("avenue_east", 1, acceleration_variance_m2ps4=-0.1)
    calm = take_snapshot(demo.network, [spread], now_ns, stale_after_s=5.0)
    assert calm.segments["avenue_east"].acceleration_variance_m2ps4 == 0.0


@pytest.mark.parametrize(("age_s", "told_s"), [(60.0, 60.0), (-3.0, 0.0), (-0.5, 0.0)])
def test_a_gate_tells_how_old_its_state_is(
    demo: RoutingProblem, state: State, now_ns: int, age_s: float, told_s: float
) -> None:
    """Stale or not; what is dated ahead has no age."""
    seen = state("avenue_east", 1, time_ns=now_ns - round(age_s * SECOND))
    (gate,) = take_snapshot(demo.network, [seen], now_ns, stale_after_s=5.0).gates()
    assert gate.age_s == told_s


def test_a_snapshot_takes_the_receivers_limits(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Dated 2 s ahead: too far; 20 s old: fresh where 30 s are allowed. States of roads that
    are not on the map are left out.
    """
    ahead = [
        state("elsewhere", 1),
        state("avenue_west", 1, time_ns=now_ns + 2 * SECOND, rsu="b"),
        state("avenue_east", 1, time_ns=now_ns + 2 * SECOND, rsu="a"),
    ]
    strict = take_snapshot(demo.network, ahead, now_ns, stale_after_s=5.0)
    old = state("avenue_east", 1, time_ns=now_ns - 20 * SECOND)
    patient = take_snapshot(demo.network, [old], now_ns, stale_after_s=30.0)
    assert [gate.open for gate in patient.gates()] == [True]
    assert [gate.open for gate in strict.gates()] == [False, False]
    assert strict.now_ns == now_ns
    assert [s.segment for s in strict.states] == ["avenue_east", "avenue_west"]


@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_every_fault_of_a_camera_closes_the_gate(
    demo: RoutingProblem, state: State, now_ns: int, fault: str
) -> None:
    """A fresh state that is unknown for a fault is closed, and planned at free flow."""
    faulty = {"reason": fault, "features": None}
    seen = msgspec.structs.replace(state("avenue_east", None, time_ns=now_ns), **faulty)
    traffic = take_snapshot(demo.network, [seen], now_ns, stale_after_s=5.0).segments["avenue_east"]
    assert (traffic.open, traffic.reason) == (False, fault)
    assert traffic.speed_mps == demo.network.segments["avenue_east"].speed_limit_mps


def test_expected_stops_stand_where_a_segment_ends_at_signals(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Watched or not, segments into a junction with signals get them, and no other does."""
    network = replace(demo.network, signals=frozenset({"depot"}))
    seen = state("avenue_east", 1, time_ns=now_ns)

    def stops(**given: float) -> dict[str, float]:
        snapshot = take_snapshot(network, [seen], now_ns, stale_after_s=5.0, **given)
        return {name: traffic.stops for name, traffic in snapshot.segments.items()}

    assert set(stops().values()) == {0.0}
    into_depot = {name for name, s in network.segments.items() if s.end == "depot"}
    assert {name for name, n in stops(stops_at_signals=0.4).items() if n == 0.4} == into_depot
    assert into_depot


def test_unwatched_segments_are_closed_at_free_flow(demo: RoutingProblem, now_ns: int) -> None:
    """Without any state every gate is closed, speeds are the limits and no gate is listed."""
    snapshot = take_snapshot(demo.network, [], now_ns, stale_after_s=5.0)
    assert snapshot.gates() == ()
    for name, traffic in snapshot.segments.items():
        assert (traffic.segment, traffic.open, traffic.reason) == (name, False, "unwatched")
        assert traffic.speed_mps == demo.network.segments[name].speed_limit_mps


@pytest.mark.parametrize(
    ("measured", "planned"), [(12.0, 12.0), (30.0, 16.67), (0.1, 1.0), (-3.0, 1.0)]
)
def test_planning_speed_is_measured_but_legal_and_moving(
    demo: RoutingProblem, state: State, now_ns: int, measured: float, planned: float
) -> None:
    """Fresh speeds are used within the speed limit and a floor."""
    seen = state("avenue_east", 1, speed_mps=measured)
    snapshot = take_snapshot(demo.network, [seen], now_ns, stale_after_s=5.0)
    assert snapshot.segments["avenue_east"].speed_mps == planned


@pytest.mark.parametrize(
    ("flags", "is_open"),
    [((1, 0), False), ((0, 1), False), ((1, None), True), ((None, None), False), ((1, 1), True)],
)
def test_two_rsus_on_one_segment_agree_on_the_safe_side(
    demo: RoutingProblem, state: State, now_ns: int, flags: tuple[int | None, ...], is_open: bool
) -> None:
    """One RSU that sees turbulence closes the gate whatever another sees."""
    states = [state("avenue_east", y, rsu=f"rsu-{i}") for i, y in enumerate(flags)]
    snapshot = take_snapshot(demo.network, states, now_ns, stale_after_s=5.0)
    assert snapshot.segments["avenue_east"].open is is_open


def test_a_gate_is_expected_to_be_as_now_at_first_and_as_usual_later() -> None:
    """Between the two by e^(−t/60 s); without history it stays as it is."""
    for now in (True, False):
        forecast = GateForecast(now, 0.4)
        assert forecast.chance(0.0) == forecast.chance(-20.0) == float(now)
        assert forecast.chance(1e6) == pytest.approx(0.4)
        assert forecast.chance(PERSISTENCE_S) == pytest.approx(0.4 + (now - 0.4) / math.e)
        assert forecast.may_be_open
        assert GateForecast(now).chance(1e6) == float(now)
        assert GateForecast(now).may_be_open == now
    assert not GateForecast(False, 0.0).may_be_open


@pytest.mark.parametrize(
    ("reason", "age_s", "usual"),
    [("turbulent", 1.0, 0.4), ("too_few_vehicles", 1.0, 0.4), ("stale", 99.0, None)],
)
def test_only_a_gate_that_is_watched_now_is_expected_to_open(
    reason: str, age_s: float, usual: float | None
) -> None:
    """Nobody would see that it is calm."""
    traffic = SegmentTraffic("road", 10.0, reason=reason, age_s=age_s)
    snapshot = TrafficSnapshot(0, {"road": traffic}, ()).with_usual_gates({"road": 0.4, "x": 1.0})
    assert set(snapshot.segments) == {"road"}
    assert snapshot.segments["road"].gate == GateForecast(False, usual)
