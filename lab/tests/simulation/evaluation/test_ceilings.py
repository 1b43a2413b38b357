"""Where energy goes, and what the same deliveries would cost at best."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from lab.tests.simulation.evaluation.fakes import GROUND, make_arm
from slipstream.energy.consumption import (
    ETA_FOLLOWER,
    drive_energies,
    steady_energy_kwh,
    stop_energy_kwh,
    trace_energy,
)
from slipstream.energy.drive import DrivingStyle, plan_drive
from slipstream.roads import Crossing, Segment, build_network
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.closed_loop.record import ArmResult, Others
from slipstream_lab.simulation.evaluation.arms import POLICIES
from slipstream_lab.simulation.evaluation.measures.ceilings import (
    compute_ceilings,
    free_drive,
    share_of_ceiling,
)
from slipstream_lab.simulation.evaluation.measures.evaluation import Evaluation, collect
from slipstream_lab.simulation.evaluation.report.ceilings import ceiling_tables
from slipstream_lab.simulation.evaluation.report.proximity import proximity_kwh
from slipstream_lab.simulation.evaluation.runs.store import ArmStore
from slipstream_lab.simulation.fleet.driven_leg import DrivenLeg
from slipstream_lab.simulation.fleet.losses import drive_losses, losses

STEP_S: Final = 0.5
CAR: Final = PRESETS["paper_car"]
ROADS: Final = build_network(
    "row",
    [
        Segment("a", "0", "1", 600.0, 14.0, 1, ((0.0, 0.0), (600.0, 0.0))),
        Segment("b", "1", "2", 500.0, 14.0, 1, ((600.0, 0.0), (1100.0, 0.0))),
        Segment("c", "2", "3", 400.0, 10.0, 1, ((1100.0, 0.0), (1500.0, 0.0))),
    ],
    {"0": (0.0, 0.0), "1": (600.0, 0.0), "2": (1100.0, 0.0), "3": (1500.0, 0.0)},
    crossings={
        ("a", "b"): Crossing(15.0, 6.0, intersection="light", signal_groups={0: 0}),
        ("b", "c"): Crossing(20.0, 14.0),
    },
)


def ramp(*points: tuple[float, float]) -> list[float]:
    """Speeds every half second through (time, speed) points."""
    times, speeds = zip(*points, strict=True)
    at = np.arange(0.0, times[-1] + STEP_S / 2, STEP_S)
    return [float(speed) for speed in np.interp(at, times, speeds)]


STOPPED: Final = ramp((0, 0), (10, 14), (40, 14), (50, 0), (70, 0), (80, 14), (130, 14), (140, 0))
"""With a stand on the way."""


def an_arm(*traces: list[float]) -> ArmResult:
    """Vehicles on the way a, b, c with these speeds every half second."""
    legs = tuple(_leg(i, trace) for i, trace in enumerate(traces))
    nobody = Others(0, 0.0, 0.0, 0.0, 0)
    return ArmResult("x", 1, "B", 0.0, 3600.0, legs, (), (), nobody, 0, 0, 0, 0, None, 0)


def _leg(number: int, trace: list[float]) -> DrivenLeg:
    seconds = STEP_S * (len(trace) - 1)
    alone = trace_energy(trace, STEP_S)
    return DrivenLeg(
        vehicle=f"van-{number}",
        round=0,
        leg=0,
        ready_s=0.0,
        due_s=0.0,
        departed_s=10.0,
        arrived_s=10.0 + seconds,
        free_s=seconds,
        distance_m=float(np.trapezoid(trace, dx=STEP_S)),
        driven=alone,
        alone=alone,
        led_m=0.0,
        followed_m=0.0,
        stops=0,
        waited_s=0.0,
        turbulent_s=0.0,
        path=("a", "b", "c"),
        losses=losses(trace, STEP_S),
    )


def test_losses_add_up_to_the_traction_energy() -> None:
    """From rest to rest nothing stays kinetic, whatever the speeds are."""
    rng = np.random.default_rng(7)
    for _ in range(5):
        speeds = np.maximum(0.0, rng.normal(8.0, 4.0, 400).cumsum() % 15.0)
        speeds[0] = speeds[-1] = 0.0
        split = losses(speeds, STEP_S)
        assert min(split) >= 0
        assert sum(split) == pytest.approx(trace_energy(speeds, STEP_S).total_kwh)


def test_braking_belongs_to_the_occasion_it_ends_with() -> None:
    """Before the end, before a stand, or neither; a ripple of less than 1 m/s parts nothing."""
    whole = stop_energy_kwh(14.0)
    end = losses(ramp((0, 0), (10, 14), (40, 14), (50, 0)), STEP_S)
    assert end.stands_kwh == end.slowing_kwh == 0.0
    assert 0.8 * whole < end.arrival_kwh < whole
    stand = losses(STOPPED, STEP_S)
    assert stand.arrival_kwh == pytest.approx(end.arrival_kwh)
    assert stand.stands_kwh == pytest.approx(end.arrival_kwh)
    assert stand.slowing_kwh == 0.0
    slow = losses(ramp((0, 0), (10, 14), (20, 14), (25, 7), (30, 14), (40, 14), (50, 0)), STEP_S)
    assert slow.stands_kwh == 0.0
    assert 0.6 * whole < slow.slowing_kwh < 0.75 * whole
    rippled = losses(
        ramp((0, 0), (10, 14), (20, 14), (25, 7), (26, 7.8), (31, 0), (40, 0), (50, 14), (60, 0)),
        STEP_S,
    )
    assert rippled.slowing_kwh == 0.0
    assert rippled.stands_kwh > 0.8 * whole


def test_a_planned_drives_losses_are_those_of_its_trace() -> None:
    """Sampling finds a drive's energy to a thousandth."""
    drive = plan_drive([300.0, 200.0], [14.0, 8.0], DrivingStyle())
    assert sum(drive_losses(drive)) == pytest.approx(
        drive_energies([drive], [[0.0, 0.0]]).sum().total_kwh, rel=1e-3
    )


def test_the_empty_road_has_turns_and_no_reds() -> None:
    """A free drive slows down for the turn and the lower limit, and stands nowhere but at the end;
    at half the pace everything is half as fast."""
    drive = free_drive(("a", "b", "c"), ROADS, CAR)
    split = drive_losses(drive)
    assert split.stands_kwh == 0.0
    assert split.slowing_kwh > 0.5 * (stop_energy_kwh(14.0) - stop_energy_kwh(6.0))
    assert drive.length_m == 600 + 15 + 500 + 20 + 400
    assert max(drive.speeds_mps) == 14.0
    assert max(free_drive(("a", "b", "c"), ROADS, CAR, 0.5).speeds_mps) == 7.0
    with pytest.raises(KeyError):
        free_drive(("a", "c"), ROADS, CAR)


def test_ceilings_are_bounds_in_their_order() -> None:
    """Nothing that was driven needs less than its ceiling; taking more away leaves less."""
    traces = [
        STOPPED,
        ramp((0, 0), (10, 14), (40, 14), (46, 5), (55, 14), (80, 14), (90, 0), (110, 0), (120, 14))
        + ramp((0, 14), (20, 14), (30, 0))[1:],
    ]
    arm = an_arm(*traces)
    found = compute_ceilings(arm, ROADS, CAR)
    exact = sum(trace_energy(trace, STEP_S, ETA_FOLLOWER).total_kwh for trace in traces)
    assert found.driven.drafted_kwh <= exact <= 1.002 * found.driven.drafted_kwh
    assert found.driven.alone_kwh == pytest.approx(sum(leg.alone.total_kwh for leg in arm.legs))
    for ideal in (found.driven, found.free, found.free_in_time, found.steady):
        assert ideal.drafted_kwh < ideal.alone_kwh
    assert found.steady.alone_kwh < found.driven.alone_kwh
    assert found.free.travel_s < found.driven.travel_s
    assert found.free_in_time.travel_s == pytest.approx(found.driven.travel_s, rel=1e-3)
    assert found.free_in_time.alone_kwh < found.free.alone_kwh < found.driven.alone_kwh
    savings = found.savings()
    assert all(0 < saving < 1 for saving in savings.values())
    assert savings["no braking, drafting"] == max(savings.values())


def test_an_arm_slower_than_the_empty_road_is_not_hurried() -> None:
    """Where the arm was faster than the empty road at the limit, that is driven at the limit."""
    hurried = an_arm(ramp((0, 0), (4, 25), (55, 25), (60, 0)))
    found = compute_ceilings(hurried, ROADS, CAR)
    assert found.free_in_time.alone_kwh == pytest.approx(found.free.alone_kwh, rel=1e-4)


def test_an_arm_without_legs_has_no_ceilings() -> None:
    """There is nothing to be a share of."""
    with pytest.raises(ValueError, match="without legs"):
        compute_ceilings(an_arm(), ROADS, CAR)
    assert share_of_ceiling(0.1, 0.0) is None
    assert share_of_ceiling(0.1, 0.2) == 0.5


def test_a_motorways_follower_saves_an_eighth() -> None:
    """13 % at 30 m/s, 6 % at 13.9 m/s (FINDINGS, "The paper", 7)."""
    for speed_mps, share in ((30.0, 0.13), (13.9, 0.057)):
        alone, following = (steady_energy_kwh(1.0, speed_mps, eta) for eta in (0.0, ETA_FOLLOWER))
        assert 1 - following / alone == pytest.approx(share, abs=0.002)


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory: pytest.TempPathFactory) -> Evaluation:
    """Made-up arms of two seeds."""
    folder = tmp_path_factory.mktemp("evaluation")
    names = ("B", "B-0.88", "C", "C+", "only-platoons", "only-coasting")
    with ArmStore(folder, GROUND, "code") as store:
        for name in names:
            for seed in (1, 2):
                arm = make_arm(POLICIES[name], seed)
                legs = tuple(replace(leg, path=("a", "b", "c")) for leg in arm.legs)
                store.put(POLICIES[name], seed, replace(arm, legs=legs))
        return collect(store, GROUND, (1, 2))


def test_tables_hold_each_lever_against_its_ceiling(evaluation: Evaluation) -> None:
    """Ceilings of the baseline, and the share of each lever that is there:
    drafting by what drag it saved, over 20 % of the baseline's drag."""
    best, reached, together = ceiling_tables(evaluation, ROADS)
    assert len(best.rows) == 4
    assert [row[0] for row in reached.rows] == [
        "platoons alone, by drag",
        "C, by drag",
        "C+, by drag",
        "coasting alone",
        "C",
        "C+",
    ]
    base = [make_arm(POLICIES["B"], seed) for seed in (1, 2)]
    ours = [make_arm(POLICIES["only-platoons"], seed) for seed in (1, 2)]
    shares = [
        sum(leg.alone.total_kwh - leg.driven.total_kwh for leg in arm.legs)
        / (0.2 * sum(leg.alone.drag_kwh for leg in of.legs))
        for arm, of in zip(ours, base, strict=True)
    ]
    assert reached.rows[0][-1].startswith(f"{50 * sum(shares):.1f}")
    assert [row[0] for row in together.rows] == ["only-platoons", "C", "C+"]
    own = [
        sum(leg.alone.total_kwh - leg.driven.total_kwh for leg in arm.legs)
        / (0.2 * sum(leg.alone.drag_kwh for leg in arm.legs))
        for arm in ours
    ]
    assert together.rows[0][1].startswith(f"{50 * sum(own):.1f}")
    with_none = Evaluation(GROUND, (1,), {}, {}, {}, {})
    assert ceiling_tables(with_none, ROADS) == ()


def test_who_is_near_on_a_segment_drafts_there_but_for_one() -> None:
    """Three vans of even speed, the third one late: by hand from the drag of their segments."""
    even = ramp((0, 0), (2, 10), (150, 10), (152, 0))
    first, second, third = an_arm(even, even, even).legs
    second = replace(second, departed_s=40.0, arrived_s=40.0 + 152.0, path=("a", "b"))
    third = replace(third, departed_s=400.0, arrived_s=552.0)
    drag = first.alone.drag_kwh
    lengths_m = {name: segment.length_m for name, segment in ROADS.segments.items()}
    together = [
        proximity_kwh((first, second, third), lengths_m, within_s, "paper")
        for within_s in (10.0, 60.0, 600.0)
    ]
    # Segment a: 600 of 1500 m, or of 1100 m; b: 500; c: 400, which the second one does not drive.
    a, b, c = (length / 1500 * drag for length in (600.0, 500.0, 400.0))
    on_a, on_b = 600 / 1100 * drag, 500 / 1100 * drag
    two = 0.05 * (a + b) + 0.2 * (on_a + on_b)
    three = two + 0.2 * (a + b + c) + 0.05 * c
    assert together == pytest.approx([0.0, two, three])
