from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dispatcher_daemon.drive import Drive, DrivingStyle, drive_energy, plan_drive
from slipstream.energy import JOULE_PER_KWH, PAPER_CAR, steady_energy_kwh

STYLE = DrivingStyle()
LEGS = st.lists(st.tuples(st.floats(5.0, 3000.0), st.floats(1.0, 40.0)), min_size=1, max_size=6)


def position_m(drive: Drive, at_s: float) -> float:
    """Distance driven by a time: integral of the profile."""
    times = np.array([*[t for t in drive.times_s if t < at_s], at_s])
    speeds = np.interp(times, drive.times_s, drive.speeds_mps)
    return float(np.trapezoid(speeds, times))


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


def test_finer_sampling_changes_nothing() -> None:
    """The trace's step is fine enough: a ten times finer one agrees within 0.001 %."""
    drive = plan_drive([494.9, 674.7, 1995.8, 408.7], [13.89, 13.89, 16.67, 13.89], STYLE)
    coarse = drive_energy(drive, [0.0, 0.0, 0.2, 0.0]).total_kwh
    fine = drive_energy(drive, [0.0, 0.0, 0.2, 0.0], step_s=0.01).total_kwh
    assert coarse == pytest.approx(fine, rel=1e-5)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_driving_style_is_checked(rate: float) -> None:
    """Rates must be positive."""
    with pytest.raises(ValueError, match="must be positive"):
        DrivingStyle(acceleration_mps2=rate)
