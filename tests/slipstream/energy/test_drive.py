from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.energy.consumption import (
    JOULE_PER_KWH,
    PAPER_CAR,
    Energy,
    drive_energies,
    steady_energy_kwh,
    total,
    trace_energy,
)
from slipstream.energy.drive import Drive, DrivingStyle, plan_drive

STYLE = DrivingStyle()
LEGS = st.lists(st.tuples(st.floats(5.0, 3000.0), st.floats(1.0, 40.0)), min_size=1, max_size=6)


def drive_energy(drive: Drive, drag_reductions: Sequence[float]) -> Energy:
    """E_physical of one drive."""
    return drive_energies([drive], [drag_reductions]).sum()


def position_m(drive: Drive, at_s: float) -> float:
    """Distance driven by a time: integral of the profile."""
    times = np.array([*[t for t in drive.times_s if t < at_s], at_s])
    speeds = np.interp(times, drive.times_s, drive.speeds_mps)
    return float(np.trapezoid(speeds, times))


@pytest.mark.slow
@given(leg=LEGS)
def test_a_drive_covers_its_segments_within_speeds_and_rates(
    leg: list[tuple[float, float]],
) -> None:
    """From rest to rest, segment by segment, never above a segment's speed or the style's rates."""
    lengths, limits = [d for d, _ in leg], [v for _, v in leg]
    drive = plan_drive(lengths, limits, STYLE)
    times, speeds = np.array(drive.times_s), np.array(drive.speeds_mps)
    assert speeds[0] == 0
    assert speeds[-1] == pytest.approx(0, abs=1e-6)
    change, step = np.diff(speeds), np.diff(times)
    assert np.all(step > 0)
    assert np.all(change <= STYLE.acceleration_mps2 * step + 1e-6)
    assert np.all(change >= -STYLE.braking_mps2 * step - 1e-6)
    assert position_m(drive, drive.duration_s) == pytest.approx(sum(lengths), rel=1e-6)
    for i, entry in enumerate(drive.entry_s):
        assert position_m(drive, entry) == pytest.approx(sum(lengths[:i]), rel=1e-6, abs=1e-3)
        end = [*drive.entry_s, drive.duration_s][i + 1]
        inside = (times >= entry - 1e-9) & (times <= end + 1e-9)
        assert speeds[inside].max() <= limits[i] + 1e-6


def test_energy_of_a_long_cruise_is_steady_energy_plus_kinetic_energy() -> None:
    """Getting up to speed costs ½mv² at the wheels; braking gives nothing back."""
    length, speed = 20_000.0, 20.0
    drive = plan_drive([length], [speed], STYLE)
    energy = drive_energy(drive, [0.0])
    kinetic = 0.5 * PAPER_CAR.mass_kg * speed**2 / (JOULE_PER_KWH * PAPER_CAR.powertrain_efficiency)
    assert energy.acceleration_kwh == pytest.approx(kinetic, rel=0.02)
    assert energy.total_kwh == pytest.approx(steady_energy_kwh(length, speed) + kinetic, rel=0.01)


def test_drag_reduction_counts_on_its_own_segment_only() -> None:
    """Drafting on the second of two like segments saves what it would on the first, not more."""
    drive = plan_drive([2000.0, 2000.0], [15.0, 15.0], STYLE)
    alone = drive_energy(drive, [0.0, 0.0]).total_kwh
    second = alone - drive_energy(drive, [0.0, 0.2]).total_kwh
    both = alone - drive_energy(drive, [0.2, 0.2]).total_kwh
    assert 0 < second < both
    assert second == pytest.approx(both / 2, rel=0.05)


def test_energy_is_what_fine_sampling_of_each_phase_gives() -> None:
    """The closed form agrees with a trace of 1 ms steps, drafting on one segment included."""
    drive = plan_drive([494.9, 674.7, 1995.8, 408.7], [13.89, 13.89, 16.67, 13.89], STYLE)
    reductions = [0.0, 0.0, 0.2, 0.0]
    sampled = []
    phases = zip(pairwise(drive.times_s), pairwise(drive.speeds_mps), strict=True)
    for (begin, end), (v0, v1) in phases:
        number = sum(entry <= (begin + end) / 2 for entry in drive.entry_s) - 1
        steps = max(1, round((end - begin) / 1e-3))
        speeds = np.linspace(v0, v1, steps + 1)
        sampled.append(trace_energy(speeds, (end - begin) / steps, reductions[number]))
    assert drive_energy(drive, reductions) == pytest.approx(total(sampled), rel=1e-6)


def test_many_drives_at_once_need_what_each_of_them_needs() -> None:
    """Energies of a list of drives are those of its members, of one that stands still too."""
    drives = [
        plan_drive([500.0, 900.0], [13.89, 16.67], STYLE),
        Drive((0.0,), (0.0,), (), 0.0),
        plan_drive([300.0], [8.33], STYLE),
    ]
    reductions = [[0.2, 0.05], [], [0.0]]
    together = drive_energies(drives, reductions)
    for number, (drive, reduction) in enumerate(zip(drives, reductions, strict=True)):
        own = drive_energy(drive, reduction)
        assert [part[number] for part in together] == pytest.approx(list(own), rel=1e-12)
    assert together.total_kwh[1] == 0


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_driving_style_is_checked(rate: float) -> None:
    """Rates must be positive."""
    with pytest.raises(ValueError, match="must be positive"):
        DrivingStyle(acceleration_mps2=rate)


def test_a_drive_that_begins_at_a_speed() -> None:
    """It is the rest of a drive from rest; a speed that it cannot have is lowered."""
    whole = plan_drive([500.0, 900.0], [13.89, 16.67], STYLE)
    rest = plan_drive([250.0, 900.0], [13.89, 16.67], STYLE, 13.89)
    assert rest.speeds_mps[0] == 13.89
    assert whole.duration_s - whole.entry_s[1] == pytest.approx(rest.duration_s - rest.entry_s[1])
    assert rest.entry_s[1] == pytest.approx(250.0 / 13.89)
    assert plan_drive([250.0], [10.0], STYLE, 30.0).speeds_mps[0] == 10.0
    short = plan_drive([3.0], [10.0], STYLE, 10.0)
    assert short.speeds_mps[0] == pytest.approx((2 * STYLE.braking_mps2 * 3.0) ** 0.5)
    assert short.speeds_mps[-1] == 0.0
