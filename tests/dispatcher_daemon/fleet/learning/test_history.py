"""Costs of movements: counted along drives, kept, and expected."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from dispatcher_daemon.fleet.learning import HOURS, DrivenTrace, History, Passages
from slipstream.energy.consumption import steady_energy_kwh, stop_energy_kwh, trace_energy
from slipstream.roads import RoadNetwork
from slipstream.roads.sumo_net import load_network

LIMIT_MPS = 12.0


def trace_of(speeds: Sequence[float], entries: Sequence[tuple[int, int]]) -> DrivenTrace:
    """A drive that begins at 8:00 over segments a, b, c and d."""
    return DrivenTrace(8 * 3600.0, "abcd", list(speeds), list(entries))


def counted(*traces: DrivenTrace) -> History:
    """The history of some drives."""
    passages = Passages(dict.fromkeys("abcd", LIMIT_MPS), 1.0)
    passages.count(traces)
    return passages.history()


def test_losses_and_times_of_a_drive_add_up_to_it() -> None:
    """From one speed to the same one, movements' losses are the trace's energy and their times its
    time, wherever it slowed down; the first and the last segment are no passages.
    """
    rng = np.random.default_rng(1)
    speeds = np.concatenate([np.full(3, LIMIT_MPS), rng.uniform(0, LIMIT_MPS, 40), [LIMIT_MPS] * 9])
    history = counted(trace_of(speeds.tolist(), [(0, 0), (2, 1), (20, 2), (44, 3)]))
    assert history.movements == (("b", "c"), ("c", "d"))
    assert history.count.sum(axis=1).tolist() == [1.0, 1.0]
    assert history.count[:, 8].tolist() == [1.0, 1.0]
    energy = trace_energy(speeds[2:45], 1.0).total_kwh
    assert history.loss_kwh.sum() == pytest.approx(energy, rel=1e-12)
    assert history.seconds.sum() == pytest.approx(42.0, rel=1e-12)


def test_a_stop_counts_where_it_is_made() -> None:
    """Braking to a stand before a turn is that turn's loss, stop and time, although speed is
    gained again behind it.
    """
    braking, gaining = np.linspace(LIMIT_MPS, 0, 9), np.linspace(0, LIMIT_MPS, 11)
    speeds = [*[LIMIT_MPS] * 10, *braking, 0.0, 0.0, *gaining, *[LIMIT_MPS] * 10]
    history = counted(trace_of(speeds, [(0, 0), (5, 1), (21, 2), (40, 3)]))
    before, behind = history.loss_kwh.sum(axis=1)
    assert before > stop_energy_kwh(LIMIT_MPS)
    metres = sum(0.5 * (a + b) for a, b in pairwise(speeds[21:41]))
    assert behind < steady_energy_kwh(metres, LIMIT_MPS)
    assert history.stops.sum(axis=1).tolist() == [1.0, 0.0]
    assert history.seconds.sum(axis=1)[0] == pytest.approx(16 + LIMIT_MPS / 2.4)


def test_drives_that_skip_a_segment_are_not_counted_there() -> None:
    """A teleported vehicle tells nothing of what it left out."""
    history = counted(trace_of([LIMIT_MPS] * 20, [(0, 0), (3, 1), (9, 3)]))
    assert history.movements == ()


def test_counting_in_parts_is_counting_at_once() -> None:
    """Drives do not touch each other, whatever is counted together."""
    rng = np.random.default_rng(2)
    drives = [
        trace_of(rng.uniform(0, LIMIT_MPS, 30).tolist(), [(0, 0), (4, 1), (12, 2), (25, 3)])
        for _ in range(3)
    ]
    passages = Passages(dict.fromkeys("abcd", LIMIT_MPS), 1.0)
    for drive in drives:
        passages.count([drive])
    one, other = passages.history(), counted(*drives)
    for name in ("count", "loss_kwh", "seconds", "stops"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9)


def known(network: RoadNetwork, pairs: Sequence[tuple[str, str]], count: float) -> History:
    """Passages at 8:00, each costing 0.2 kWh and 90 s."""
    table = np.zeros((len(pairs), HOURS))
    table[:, 8] = count
    return History(tuple(sorted(pairs)), table, 0.2 * table, 90.0 * table, table)


def test_many_passages_are_believed_few_are_drawn_to_the_mean() -> None:
    """Expectations go from the mean of all to a movement's own the more passages it has; where
    nobody ever drove it is physics.
    """
    network = load_network("demo")
    pair = next((a, b) for a in network.segments for b in network.follows[a])
    segment = network.segments[pair[0]]
    steady = steady_energy_kwh(segment.length_m, segment.speed_limit_mps)
    none = known(network, [], 0.0).expectations(network, 8)
    assert none.loss_kwh[pair] == pytest.approx(steady)
    assert none.seconds[pair] == pytest.approx(segment.free_flow_s)
    assert set(none.loss_kwh) == {(a, b) for a in network.segments for b in network.follows[a]}
    much = known(network, [pair], 1e6).expectations(network, 8)
    assert much.loss_kwh[pair] == pytest.approx(0.2, rel=1e-3)
    assert much.seconds[pair] == pytest.approx(90.0, rel=1e-3)
    assert (none.stops[pair], much.stops[pair]) == (0.0, pytest.approx(1.0, rel=1e-3))
    others = [(a, b) for a in network.segments for b in network.follows[a] if a != pair[0]]
    mixed = known(network, [pair, *others], 1e6)
    mixed.loss_kwh[mixed.movements.index(pair)] = 0.0
    mixed.count[mixed.movements.index(pair)] = 0.0
    mixed.count[mixed.movements.index(pair), 8] = 4.0
    few = mixed.expectations(network, 8).loss_kwh[pair]
    assert 0.2 * steady <= few < 0.2
    at_night = mixed.expectations(network, 2).loss_kwh[others[0]]
    assert at_night == pytest.approx(0.2, rel=1e-3)
