"""What the dispatcher counts for each RSU: missed, twice, late, clock."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client import REGISTRY

from dispatcher_daemon import metrics
from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher.reports import worst_receptions
from dispatcher_daemon.traffic.reception import (
    DELAYS,
    MAX_JUMP,
    MAX_RSUS,
    SETTLE_S,
    Reception,
    ReceptionTable,
)
from dispatcher_daemon.traffic.states import LatestStates, Verdict
from slipstream.messages import SegmentState

SECOND = 1_000_000_000
State = Callable[..., SegmentState]


def counted(sequences: Sequence[int], times_s: Sequence[int] | None = None) -> Reception:
    """The reception of an RSU whose states come in this order; by default dated by their number."""
    table = ReceptionTable()
    for sequence, second in zip(sequences, times_s or sequences, strict=True):
        table.count("r", sequence, second * SECOND, 0.1, out_of_order=False)
    ((_, found),) = table.figures()
    return found


@pytest.mark.long
@pytest.mark.slow
@given(st.sets(st.integers(1, 200), min_size=1), st.randoms())
def test_missed_are_the_gaps_whatever_the_order(arrived: set[int], random: object) -> None:
    """A late state fills its gap; the first and the last that came bound what is counted."""
    first, *rest = sorted(arrived)
    random.shuffle(rest)  # type: ignore[attr-defined]
    found = counted([first, *rest], [0] * len(arrived))
    assert found.missed == max(arrived) - first + 1 - len(arrived)
    assert found.received == len(arrived)


def test_a_restart_misses_nothing() -> None:
    """Numbers that begin again at a later time are of another run; gaps of the one before stay."""
    assert counted([7, 9, 1, 2, 4], [7, 9, 20, 21, 22]).missed == 1 + 1
    assert counted([7, 9, 1, 2, 4], [7, 9, 20, 21, 22]).received == 5


@pytest.mark.parametrize("beat_first", [True, False])
def test_what_is_missed_while_the_dispatcher_stands_still_is_its_own(beat_first: bool) -> None:
    """A gap of its beats: no RSU is blamed for that time, and each is again after it."""
    now_s = 0.0
    table = ReceptionTable(lambda: now_s)

    def count(sequence: int) -> None:
        delay_s = 12.0 if now_s == 15.0 else 0.1
        table.count("r", sequence, sequence * SECOND, delay_s, out_of_order=False)

    def missed() -> int:
        ((_, found),) = table.figures()
        return found.missed

    for second in range(4):
        now_s = float(second)
        table.beat()
        count(second)
    count(6)
    assert (missed(), table.stops, table.missed_here) == (2, 0, 0)
    now_s += 12.0
    if beat_first:
        table.beat()
    count(18)
    table.beat()
    assert (missed(), table.stops, table.missed_here) == (2, 1, 11)
    count(17)
    assert (missed(), table.missed_here) == (2, 10)
    ((_, found),) = table.figures()
    assert (found.delay_s, found.delay_spread_s) == (0.1, 0.0), "nor for what waited"
    for _ in range(int(SETTLE_S) + 1):
        now_s += 1.0
        table.beat()
    count(22)
    assert (missed(), table.stops, table.missed_here) == (5, 1, 10)


@pytest.mark.parametrize("first", [True, False])
def test_a_state_of_the_future_hides_no_restart(first: bool) -> None:
    """A clock that was a day ahead for one state: the next restart is seen, with no gap from it."""
    table = ReceptionTable()
    day_s = 86_400
    arrivals = [(6, 0, day_s)] if first else [(6, 0, 0), (7, 1, day_s)]
    arrivals += [(1, 20, 0), (2, 21, 0), (4, 22, 0)]
    for sequence, arrived_s, ahead_s in arrivals:
        time_ns = (arrived_s + ahead_s) * SECOND
        table.count("r", sequence, time_ns, -float(ahead_s), out_of_order=False)
    ((_, found),) = table.figures()
    assert (found.received, found.missed) == (len(arrivals), 1)


@pytest.mark.slow
@given(st.lists(st.floats(-100, 100), min_size=2, max_size=3 * DELAYS))
def test_delays_are_judged_by_the_latest_ones(delays_s: list[float]) -> None:
    """Median and interquartile range are those of the standard library, of the last `DELAYS`."""
    table = ReceptionTable()
    for number, delay_s in enumerate(delays_s):
        table.count("r", number, number * SECOND, delay_s, out_of_order=False)
        ((_, found),) = table.figures()
        latest = delays_s[max(0, number + 1 - DELAYS) : number + 1]
        if number:
            lower, median, upper = statistics.quantiles(latest, n=4, method="inclusive")
            assert found.delay_s == pytest.approx(median)
            assert found.delay_spread_s == pytest.approx(upper - lower)


def test_an_absurd_jump_is_no_gap() -> None:
    """One number out of nowhere does not make millions missed."""
    assert counted([1, 2, 2 + MAX_JUMP]).missed == MAX_JUMP - 1
    assert counted([1, 2, 3 + MAX_JUMP]).missed == 0


def test_each_rsu_is_counted_by_what_its_states_are(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """Duplicates, disorder and delay of admitted senders; strangers count for nobody."""
    states = LatestStates(demo.network, rsus={"rsu-1": ("avenue_east",), "ahead": ("avenue_east",)})

    def arrive(sequence: int, second: int, rsu: str, delay_s: float) -> Verdict:
        time_ns = now_ns + second * SECOND
        message = state("avenue_east", 1, rsu=rsu, sequence=sequence, time_ns=time_ns)
        return states.accept(message, time_ns + round(delay_s * SECOND))

    for number, delay_s in enumerate((0.1, 0.2, 0.3, 0.4, 0.5)):
        assert arrive(10 + number, number, "rsu-1", delay_s) is Verdict.ACCEPTED
    assert arrive(14, 4, "rsu-1", 0.9) is Verdict.DUPLICATE
    assert arrive(9, 3, "rsu-1", 9.0) is Verdict.OUT_OF_ORDER
    assert arrive(20, 5, "rsu-1", 0.3) is Verdict.ACCEPTED
    assert arrive(1, 0, "ahead", -30.0) is Verdict.FUTURE
    assert arrive(1, 0, "stranger", 0.1) is Verdict.UNLISTED
    found = dict(states.reception.figures())
    assert set(found) == {"ahead", "rsu-1"}
    assert found["ahead"].delay_s == pytest.approx(-30.0)
    own = found["rsu-1"]
    assert (own.received, own.missed, own.duplicates, own.out_of_order) == (6, 5, 1, 1)
    assert own.delay_s == pytest.approx(0.3)
    assert own.delay_spread_s == pytest.approx(0.15)
    assert [row.rsu for row in worst_receptions(found.items())] == ["rsu-1", "ahead"]


def test_an_implausible_state_is_not_missed(
    demo: RoutingProblem, state: State, now_ns: int
) -> None:
    """It came, with its number, whatever it says."""
    states = LatestStates(demo.network, rsus={"r": ("avenue_east",)})
    verdicts = []
    for number in range(3):
        message = state("avenue_east", 1, rsu="r", sequence=number, time_ns=now_ns + number)
        if number == 1:
            message = msgspec.structs.replace(message, vehicles=10**6)
        verdicts.append(states.accept(message, now_ns + number))
    assert verdicts == [Verdict.ACCEPTED, Verdict.IMPLAUSIBLE, Verdict.ACCEPTED]
    ((_, found),) = states.reception.figures()
    assert (found.received, found.missed) == (3, 0)


def test_metrics_carry_the_name_of_the_rsu() -> None:
    """Prometheus sees each figure of each RSU."""
    before = metrics.RECEPTION.figures
    found = Reception(
        received=9, missed=3, duplicates=2, out_of_order=1, delay_s=-0.5, delay_spread_s=0.25
    )
    metrics.RECEPTION.figures = lambda: [("r", found)]
    try:
        rows = {
            (sample.name.removeprefix("slipstream_dispatcher_rsu_"), sample.labels.get("kind")): (
                sample.value
            )
            for family in REGISTRY.collect()
            for sample in family.samples
            if sample.labels.get("rsu") == "r"
        }
    finally:
        metrics.RECEPTION.figures = before
    assert rows == {
        ("states_total", "received"): 9,
        ("states_total", "duplicate"): 2,
        ("states_total", "out_of_order"): 1,
        ("missed", None): 3,
        ("delay_seconds", None): -0.5,
        ("delay_spread_seconds", None): 0.25,
    }


@pytest.mark.slow
@pytest.mark.attack
def test_made_up_rsus_are_bounded() -> None:
    """The one that has been silent for longest is forgotten first."""
    table = ReceptionTable()
    for number in range(MAX_RSUS):
        table.count(f"rsu-{number}", 1, 0, 0.0, out_of_order=False)
    table.count("rsu-0", 2, SECOND, 0.0, out_of_order=False)
    table.count("one more", 1, 0, 0.0, out_of_order=False)
    names = {rsu for rsu, _ in table.figures()}
    assert len(names) == MAX_RSUS
    assert {"rsu-0", "one more"} <= names
    assert "rsu-1" not in names
