"""One rule says which message counts, for the dispatcher's gates and for the page alike."""

from __future__ import annotations

from itertools import permutations

import pytest

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import DispatcherSettings
from slipstream.freshness import STALE_AFTER_S, decisive, fault, is_ahead
from slipstream.messages import Estimate, KinematicFeatures, SegmentState

S = 1_000_000_000
NOW_NS = 1_795_000_000 * S
FEATURES = KinematicFeatures(
    mean_speed_mps=Estimate(value=15.0),
    mean_acceleration_mps2=Estimate(value=0.0),
    density_veh_per_m=Estimate(value=0.02),
    speed_std_mps=Estimate(value=0.5),
    acceleration_variance_m2ps4=Estimate(value=0.1),
)


def _state(rsu: str, y_e: int | None, age_s: float = 0.0, features: bool = True) -> SegmentState:
    return SegmentState(
        rsu=rsu,
        segment="avenue",
        sequence=1,
        time_ns=NOW_NS - round(age_s * S),
        window_s=10.0,
        features=FEATURES if features else None,
        y_e=y_e,
        reason="uncertain" if y_e is None else None,
        vehicles=8,
        frames=300,
        coverage=1.0,
    )


@pytest.mark.parametrize(
    ("age_ns", "expected"),
    [
        (0, None),
        (5 * S, None),
        (5 * S + 1000, "stale"),
        (-1 * S, None),
        (-1 * S - 1000, "future"),
        (86_400 * S, "stale"),
        (-86_400 * S, "future"),
    ],
)
def test_limits_belong_to_what_counts(age_ns, expected):
    """A message counts up to and at its age limit, and up to and at the clock tolerance ahead."""
    assert fault(NOW_NS - age_ns, NOW_NS) == expected
    assert is_ahead(NOW_NS - age_ns, NOW_NS) == (expected == "future")


@pytest.mark.parametrize(
    ("states", "rsu", "reason"),
    [
        ([_state("a", 1), _state("b", 0, 4.0)], "b", None),
        ([_state("a", None), _state("b", 1, 4.0)], "b", None),
        ([_state("a", 1), _state("b", 0, 6.0)], "a", None),
        ([_state("a", None, 4.0), _state("b", 0, -3.0)], "a", None),
        ([_state("a", None, 4.0, features=False), _state("b", 0, -3.0)], "a", None),
        ([_state("a", 1, 2.0), _state("b", 1, 1.0)], "b", None),
        ([_state("a", None, 2.0), _state("b", None, 1.0, features=False)], "a", None),
        ([_state("a", 1), _state("b", 1)], "b", None),
        ([_state("a", 1, 7.0), _state("b", 0, 9.0)], "a", "stale"),
        ([_state("a", 1, 7.0), _state("b", 0, -9.0)], "b", "future"),
    ],
)
def test_the_decisive_state(states, rsu, reason):
    """Fresh before not, turbulent before stable before unknown, in any order of arrival."""
    for order in permutations(states):
        chosen = decisive(order, NOW_NS)
        assert (chosen.state.rsu, chosen.fault) == (rsu, reason)


def test_limits_may_be_set():
    """Age limit and clock tolerance are settings of the receiver."""
    ahead_ns, old_ns = NOW_NS + 2 * S, NOW_NS - 8 * S
    assert fault(ahead_ns, NOW_NS, future_tolerance_s=2.0) is None
    assert fault(old_ns, NOW_NS, stale_after_s=8.0) is None
    assert fault(NOW_NS - 2 * S, NOW_NS, stale_after_s=1.0) == "stale"
    near = _state("a", 1, -0.5)
    chosen = decisive([near], NOW_NS, future_tolerance_s=0.1, stale_after_s=0.1)
    assert (chosen.fault, chosen.age_s) == ("future", -0.5)
    chosen = decisive([_state("a", 1, 2.0)], NOW_NS, stale_after_s=1.0)
    assert (chosen.fault, chosen.age_s) == ("stale", 2.0)


def test_no_states():
    """A segment without states has no decisive one."""
    assert decisive([], NOW_NS) is None


def test_both_daemons_have_the_same_defaults():
    """The page and the gates judge by the same limits unless told otherwise."""
    dispatcher, dashboard = DispatcherSettings(), DashboardSettings()
    assert dispatcher.stale_after_s == dashboard.stale_after_s == STALE_AFTER_S
