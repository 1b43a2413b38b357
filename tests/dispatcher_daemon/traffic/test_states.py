"""Which states are admitted: by sender, by value, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.traffic.snapshot import take_snapshot
from dispatcher_daemon.traffic.states import (
    FORGOTTEN_AFTER,
    MAX_RSUS_PER_SEGMENT,
    LatestStates,
    Verdict,
)
from slipstream.errors import InputError
from slipstream.messages import Estimate, SegmentState, decode
from slipstream.roads.admission import check_rsus, implausibility

State = Callable[..., SegmentState]
SECOND = 1_000_000_000


def test_verdicts_tell_duplicates_late_and_wrong_states(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Duplicates, out-of-order, future-dated and unknown-road states change nothing."""
    latest_states = LatestStates(demo.network)
    newest = state("avenue_east", 1, sequence=9)
    assert latest_states.accept(newest, now_ns) is Verdict.ACCEPTED
    assert latest_states.accept(newest, now_ns) is Verdict.DUPLICATE
    late = state("avenue_east", 0, time_ns=now_ns - SECOND, sequence=8)
    assert latest_states.accept(late, now_ns) is Verdict.OUT_OF_ORDER
    same_time = state("avenue_east", 0, sequence=10)
    assert latest_states.accept(same_time, now_ns) is Verdict.OUT_OF_ORDER
    ahead = state("avenue_east", 0, time_ns=now_ns + 2 * SECOND)
    assert latest_states.accept(ahead, now_ns) is Verdict.FUTURE
    assert latest_states.accept(state("elsewhere", 1), now_ns) is Verdict.UNKNOWN_SEGMENT
    assert latest_states.latest() == (newest,)


def test_restarted_rsu_is_heard_again(demo: RoutingProblem, state: State, now_ns: int) -> None:
    """A sequence number that starts again does not make a newer state late."""
    latest_states = LatestStates(demo.network)
    latest_states.accept(state("avenue_east", 1, sequence=900), now_ns)
    after = state("avenue_east", 0, sequence=0, time_ns=now_ns + SECOND)
    assert latest_states.accept(after, now_ns + SECOND) is Verdict.ACCEPTED
    assert latest_states.latest() == (after,)


def test_a_clock_set_back_blocks_nothing(demo: RoutingProblem, state: State, now_ns: int) -> None:
    """A held state that a clock step has left in the future gives way to the next one."""
    latest_states = LatestStates(demo.network)
    latest_states.accept(state("avenue_east", 1, sequence=5), now_ns)
    earlier = now_ns - 3600 * SECOND
    fresh = state("avenue_east", 0, sequence=6, time_ns=earlier)
    assert latest_states.accept(fresh, earlier) is Verdict.ACCEPTED


def test_made_up_rsus_are_bounded(demo: RoutingProblem, state: State, now_ns: int) -> None:
    """Made-up RSU names cannot fill the memory."""
    latest_states = LatestStates(demo.network)
    verdicts = [
        latest_states.accept(state("avenue_east", 1, rsu=f"rsu-{i}"), now_ns)
        for i in range(MAX_RSUS_PER_SEGMENT + 3)
    ]
    assert verdicts[-3:] == [Verdict.TOO_MANY_RSUS] * 3
    assert len(latest_states.latest()) == MAX_RSUS_PER_SEGMENT


@given(order=st.permutations(range(6)))
def test_latest_state_wins_in_any_order_of_arrival(
    demo: RoutingProblem, state: State, now_ns: int, order: list[int]
) -> None:
    """Whatever order states arrive in, the newest is kept."""
    latest_states = LatestStates(demo.network)
    for i in order:
        seen = state("avenue_east", i % 2, sequence=i, time_ns=now_ns - (6 - i) * SECOND)
        latest_states.accept(seen, now_ns)
    (held,) = latest_states.latest()
    assert held.sequence == 5


@pytest.mark.attack
def test_an_rsu_opens_only_the_segments_that_it_is_listed_for(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """States of all segments from one RSU, and of its segment from an unlisted one."""
    listed = LatestStates(demo.network, rsus={"rsu-1": ("avenue_east",)})
    verdicts = {
        name: listed.accept(state(name, 1, rsu="rsu-1", time_ns=now_ns), now_ns)
        for name in demo.network.segments
    }
    assert verdicts.pop("avenue_east") is Verdict.ACCEPTED
    assert set(verdicts.values()) == {Verdict.UNLISTED}
    stranger = state("avenue_east", 1, rsu="rsu-2", time_ns=now_ns)
    assert listed.accept(stranger, now_ns) is Verdict.UNLISTED
    snapshot = take_snapshot(demo.network, listed.latest(), now_ns, stale_after_s=5.0)
    assert [gate.segment for gate in snapshot.gates() if gate.open] == ["avenue_east"]


@pytest.mark.attack
def test_a_list_with_a_segment_that_the_network_lacks_is_bad_input(demo: RoutingProblem) -> None:
    """A misspelt segment would keep its gate shut for good."""
    check_rsus({"rsu-1": ("avenue_east",)}, demo.network, "dispatcher.toml")
    with pytest.raises(InputError, match=r"rsus\.rsu-1: the network has no segment avenue_esat"):
        check_rsus({"rsu-1": ("avenue_esat",)}, demo.network, "dispatcher.toml")


@pytest.mark.attack
def test_silent_rsus_give_up_their_places(demo: RoutingProblem, state: State, now_ns: int) -> None:
    """Invented RSUs that fall silent lock the real one out for 30 s at the default age limit."""
    states = LatestStates(demo.network, stale_after_s=5.0)
    for i in range(MAX_RSUS_PER_SEGMENT):
        states.accept(state("avenue_east", None, rsu=f"squatter-{i}", time_ns=now_ns), now_ns)

    def real(after_s: float) -> Verdict:
        later = now_ns + round(after_s * SECOND)
        return states.accept(state("avenue_east", 1, rsu="rsu-1", time_ns=later), later)

    assert FORGOTTEN_AFTER * 5.0 == 30.0
    assert real(29.9) is Verdict.TOO_MANY_RSUS
    assert real(30.1) is Verdict.ACCEPTED
    assert [held.rsu for held in states.latest()] == ["rsu-1"]


@pytest.mark.attack
@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"mean_speed_mps": -5.0}, "mean_speed_mps = -5"),
        ({"mean_speed_mps": 71.0}, "mean_speed_mps = 71"),
        ({"mean_speed_mps": 40.0}, "mean_speed_mps = 40 where 16.67 is allowed"),
        ({"mean_acceleration_mps2": 1e6}, "mean_acceleration_mps2 = 1e+06"),
        ({"density_veh_per_m": -0.1}, "density_veh_per_m = -0.1"),
        ({"density_veh_per_m": 50.0}, "density_veh_per_m = 50"),
        ({"speed_std_mps": -1.0}, "speed_std_mps = -1"),
        ({"acceleration_variance_m2ps4": 1e308}, "acceleration_variance_m2ps4 = 1e+308"),
        ({"mean_gap_m": -100.0}, "mean_gap_m = -100"),
        ({"window_s": 1e9}, "a window of 1e+09 s"),
        ({"vehicles": 10**9}, "1000000000 vehicles"),
        ({"frames": 0}, "a flag without a frame"),
        ({"error": 1e300}, "mean_speed_mps with a standard error of 1e+300"),
    ],
)
def test_an_absurd_state_is_refused_with_its_reason(
    demo: RoutingProblem, state: State, now_ns: int, changes: dict[str, Any], what: str
) -> None:
    """A flag of 1 does not make impossible figures count."""
    plain = state("avenue_east", 1, time_ns=now_ns)
    assert plain.features is not None
    top = {k: v for k, v in changes.items() if k in SegmentState.__struct_fields__}
    features = {
        name: Estimate(value=value, standard_error=0.1)
        for name, value in changes.items()
        if name not in top and name != "error"
    }
    if "error" in changes:
        features = {"mean_speed_mps": Estimate(value=10.0, standard_error=changes["error"])}
    absurd = msgspec.structs.replace(
        plain, features=msgspec.structs.replace(plain.features, **features), **top
    )
    assert decode(SegmentState, absurd.to_bytes(), "k") == absurd
    states = LatestStates(demo.network)
    assert states.accept(plain, now_ns) is Verdict.ACCEPTED
    later = msgspec.structs.replace(absurd, time_ns=now_ns + SECOND)
    assert states.accept(later, now_ns + SECOND) is Verdict.IMPLAUSIBLE
    assert states.latest() == (plain,)
    assert what in (implausibility(absurd, demo.network.segments["avenue_east"]) or "")
