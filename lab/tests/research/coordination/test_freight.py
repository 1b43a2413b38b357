"""The laws of freight: the same seed the same trips, and what docs/coordination.md says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from slipstream.energy.traction import ETA_FOLLOWER, drag_saving_kwh
from slipstream.errors import InputError
from slipstream_lab.research.coordination.trips.corridor import (
    DENSITIES,
    corridor_freight,
    scenario_freight,
)
from slipstream_lab.research.coordination.trips.freight import MS
from slipstream_lab.research.coordination.trips.region import region_freight
from slipstream_lab.simulation.scenarios.scenario import load_scenario


@pytest.mark.parametrize("carriers", ["one", "ten"])
def test_windows_differ_in_time_only(carriers: str) -> None:
    """The same trips around the same preferred times; ±w leaves 2w to wait."""
    kind = "one" if carriers == "one" else "ten"
    narrow, wide = corridor_freight(50, 1, kind), corridor_freight(50, 30, kind)
    assert narrow.trips == corridor_freight(50, 1, kind).trips
    assert narrow.trips != corridor_freight(50, 1, kind, seed=2).trips
    for a, b in zip(narrow.trips, wide.trips, strict=True):
        assert (a.path, a.carrier) == (b.path, b.carrier)
        assert a.ready_ms - b.ready_ms == 29 * 60 * MS
        assert narrow.slack_ms(a) == 2 * 60 * MS
        assert wide.slack_ms(b) == 60 * 60 * MS


def test_one_carrier_drives_between_depot_and_towns_in_waves() -> None:
    """Half out, half back, ready within half an hour of every second hour; the last wave at 21."""
    freight = corridor_freight(500, 5, "one")
    preferred_s = np.array([t.ready_ms / MS + 300 for t in freight.trips])
    last = preferred_s >= 75_600
    assert last.any()
    assert (preferred_s[last] <= 75_600 + 1800).all()
    assert (preferred_s[~last] % 7200 <= 1800).all()
    out = [t.path[0] == "e1_on" for t in freight.trips]
    assert 0.4 < np.mean(out) < 0.6
    back = [t.path[-1] == "n1-s1" for t in freight.trips]
    assert all(a != b for a, b in zip(out, back, strict=True))
    assert {t.carrier for t in freight.trips} == {"carrier-1"}


def test_ten_carriers_use_the_motorway() -> None:
    """All have trips, all of which drive where platoons may, some from end to end."""
    freight = corridor_freight(DENSITIES[-1], 5, "ten")
    assert len({t.carrier for t in freight.trips}) == 10
    ends = {(t.path[0], t.path[-1]) for t in freight.trips}
    assert ("e0_main", "e10_main") in ends
    hours = np.array([t.ready_ms / MS + 300 for t in freight.trips]) // 3600
    assert (hours < 4).sum() < (np.abs(hours - 10) < 2).sum() / 3


def test_segments_are_the_scenarios() -> None:
    """A motorway segment at its limit with the paper's car; ramps are closed."""
    segments = corridor_freight(20, 5, "one").segments
    main = segments["e3_main"]
    assert main.duration_ms == round(main.length_m / 30.0 * MS)
    assert main.follower_kwh == pytest.approx(drag_saving_kwh(main.length_m, 30.0, ETA_FOLLOWER))
    assert main.stop_kwh is None
    assert segments["e3_join"].stop_kwh == pytest.approx(0.256, abs=1e-3)
    assert not segments["e3_on"].is_open


@pytest.mark.slow
def test_other_scenarios_have_the_same_law() -> None:
    """On Troy all trips drive where an RSU watches, and where none watches nothing is planned."""
    troy = load_scenario("troy")
    assert troy.rsus is not None
    watched = {stretch.segment for rsu in troy.rsus for stretch in rsu.watch}
    one, ten = (scenario_freight(troy, 40, 10, carriers) for carriers in ("one", "ten"))
    assert len(one.trips) == len(ten.trips) == 40
    assert not any(watched.isdisjoint(trip.path) for trip in (*one.trips, *ten.trips))
    for carriers in ("one", "ten"):
        with pytest.raises(InputError, match=r"troy: --rsus: no way between .* an RSU watches"):
            scenario_freight(replace(troy, rsus=()), 40, 10, carriers)


def test_region() -> None:
    """400 km each way, trips of 20 km and more by trucks at 25 m/s."""
    freight = region_freight(10, trucks=300)
    total_m = sum(s.length_m for s in freight.segments.values())
    assert total_m == 800_000
    assert min(len(t.path) for t in freight.trips) >= 2
    assert {s.duration_ms for s in freight.segments.values()} == {400_000}
