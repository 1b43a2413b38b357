"""Physics of traction."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from slipstream.energy.consumption import (
    ETA_FOLLOWER,
    PAPER_CAR,
    Energy,
    VehicleParameters,
    drag_saving_kwh,
    phase_energies,
    split_saving,
    stack_traces,
    steady_energy_kwh,
    stop_energy_kwh,
    total,
    trace_energies,
    trace_energy,
    wheel_power_w,
)


def test_steady_power_is_what_the_formula_gives_by_hand() -> None:
    """At 13.9 m/s the paper's car needs 2.95 kW against rolling and 1.18 kW against drag."""
    assert PAPER_CAR.rolling_force_n * 13.9 == pytest.approx(2945, abs=1)
    assert PAPER_CAR.drag_force_n(13.9) * 13.9 == pytest.approx(1184, abs=1)
    assert float(wheel_power_w(13.9, 0.0)) == pytest.approx(4130, abs=2)


def test_braking_costs_nothing_and_gives_nothing_back() -> None:
    """Negative wheel power counts as zero."""
    assert float(wheel_power_w(20.0, -3.0)) == 0.0


def test_a_stop_from_13_4_mps_costs_51_wh_to_drive_off_from() -> None:
    """Driving off to 13.4 m/s costs the kinetic energy over the powertrain's efficiency."""
    speed = np.linspace(0.0, 13.4, 201)
    energy = trace_energy(speed, 0.05)
    assert energy.acceleration_kwh * 1e3 == pytest.approx(51.0, abs=0.1)


@pytest.mark.slow
@given(
    st.lists(st.floats(0.0, 40.0), min_size=2, max_size=60),
    st.sampled_from([0.1, 0.5, 1.0]),
    st.floats(0.0, 0.3),
)
def test_the_parts_of_the_energy_add_up(speeds: list[float], step_s: float, eta: float) -> None:
    """Rolling, drag and acceleration sum to the total, which is the integral of wheel power."""
    energy = trace_energy(speeds, step_s, eta)
    v = np.array(speeds)
    power = wheel_power_w((v[1:] + v[:-1]) / 2, np.diff(v) / step_s, eta)
    assert energy.total_kwh == pytest.approx(power.sum() * step_s / 3.6e6 / 0.88, abs=1e-12)
    assert energy.rolling_kwh + energy.drag_kwh + energy.acceleration_kwh == pytest.approx(
        energy.total_kwh, abs=1e-12
    )
    assert energy.total_kwh >= 0


@given(st.floats(1.0, 40.0), st.floats(1.0, 5000.0), st.floats(0.0, 0.5))
def test_a_steady_drive_costs_the_same_by_trace_and_by_formula(
    speed: float, distance: float, eta: float
) -> None:
    """c_ij equals the integral at constant speed, and drafting saves exactly s_{e,k,l}."""
    step = distance / speed / 10
    trace = trace_energy(np.full(11, speed), step, eta)
    alone = steady_energy_kwh(distance, speed)
    assert trace.total_kwh == pytest.approx(steady_energy_kwh(distance, speed, eta), rel=1e-9)
    assert alone - trace.total_kwh == pytest.approx(
        drag_saving_kwh(distance, speed, eta), rel=1e-6, abs=1e-12
    )


def test_a_steady_drive_in_traffic_that_speeds_up_or_slows_down() -> None:
    """Mean acceleration costs its work over the distance; none is given back where it brakes."""
    level, faster = (steady_energy_kwh(1000.0, 10.0, 0.0, a) for a in (0.0, 0.5))
    assert faster - level == pytest.approx(PAPER_CAR.electrical_kwh(1800.0 * 0.5 * 1000.0))
    assert steady_energy_kwh(1000.0, 10.0, 0.0, -3.0) == 0.0
    heavy = VehicleParameters(mass_kg=3600.0)
    assert steady_energy_kwh(1000.0, 0.0, vehicle=heavy) == pytest.approx(
        2 * steady_energy_kwh(1000.0, 0.0)
    )


def test_a_follower_saves_5_7_percent_at_city_speed_and_13_on_a_motorway() -> None:
    """The drafting shares that the literature's 20 % of drag comes to."""
    for speed, share in ((13.9, 0.057), (30.0, 0.130)):
        saved = drag_saving_kwh(1000.0, speed, ETA_FOLLOWER) / steady_energy_kwh(1000.0, speed)
        assert saved == pytest.approx(share, abs=0.001)


@pytest.mark.parametrize("field", ["mass_kg", "drag_coefficient", "powertrain_efficiency"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_vehicles_are_refused(field: str, value: float) -> None:
    """Vehicle data must be positive and finite."""
    with pytest.raises(ValueError, match=field):
        VehicleParameters(**{field: value})


def test_no_powertrain_gives_more_than_it_takes() -> None:
    """An efficiency of 1 is the most that there is."""
    assert VehicleParameters(powertrain_efficiency=1.0).electrical_kwh(3.6e6) == 1.0
    with pytest.raises(ValueError, match=r"^powertrain_efficiency must be at most 1$"):
        VehicleParameters(powertrain_efficiency=1.001)


@pytest.mark.slow
@given(
    st.lists(st.lists(st.floats(0.0, 40.0), min_size=1, max_size=12), min_size=1, max_size=6),
    st.floats(0.0, 0.3),
)
def test_a_stack_of_trajectories_needs_what_each_of_them_needs(
    traces: list[list[float]], eta: float
) -> None:
    """Filling short rows up adds nothing and takes nothing away; a fleet needs the rows' sum."""
    stack = trace_energies(stack_traces(traces), 0.5, eta)
    rows = [trace_energy(trace, 0.5, eta) for trace in traces]
    for number, row in enumerate(rows):
        assert [part[number] for part in stack] == pytest.approx(list(row), rel=1e-12, abs=1e-15)
    assert stack.sum() == pytest.approx(total(rows), rel=1e-12, abs=1e-15)


def test_plans_and_trajectories_may_be_stacked_in_any_depth() -> None:
    """Shape (plans, vehicles, samples) gives (plans, vehicles), with a drag reduction of each."""
    speeds = np.random.default_rng(1).uniform(0, 20, (3, 4, 30))
    eta = np.array([0.0, 0.05, 0.2])[:, None, None]
    deep = trace_energies(speeds, 0.1, eta)
    assert deep.total_kwh.shape == (3, 4)
    single = trace_energy(speeds[2, 1], 0.1, 0.2)
    assert [part[2, 1] for part in deep] == pytest.approx(list(single), rel=1e-12)
    assert total([]) == Energy(0, 0, 0, 0)


@pytest.mark.slow
@given(
    start=st.floats(0.0, 40.0),
    end=st.floats(0.0, 40.0),
    seconds=st.floats(0.1, 60.0),
    eta=st.floats(0.0, 0.3),
)
def test_a_phase_in_closed_form_is_the_limit_of_fine_sampling(
    start: float, end: float, seconds: float, eta: float
) -> None:
    """Whether it pulls all the way, part of it (slow braking) or not at all."""
    sampled = trace_energy(np.linspace(start, end, 4001), seconds / 4000, eta)
    exact = phase_energies(start, end, seconds, eta)
    scale = max(1e-9, sampled.rolling_kwh + sampled.drag_kwh, abs(sampled.acceleration_kwh))
    # A sample pulls wholly or not at all.
    fastest, force_n = max(start, end), PAPER_CAR.mass_kg * abs(end - start) / seconds
    one_sample = PAPER_CAR.electrical_kwh(force_n * fastest * seconds / 4000)
    assert [float(part) for part in exact] == pytest.approx(
        list(sampled), rel=0, abs=2e-3 * scale + one_sample
    )


def test_slow_braking_pulls_only_while_drag_is_large() -> None:
    """At −0.2 m/s² resistance and inertia cancel at 18.3 m/s; below that nothing is needed."""
    cancel = np.sqrt((1800 * 0.2 - PAPER_CAR.rolling_force_n) / PAPER_CAR.drag_factor_kgpm)
    assert cancel == pytest.approx(18.3, abs=0.1)
    assert phase_energies(cancel, 5.0, (cancel - 5) / 0.2).total_kwh == pytest.approx(0, abs=1e-12)
    above = phase_energies(30.0, cancel, (30 - cancel) / 0.2).total_kwh
    assert phase_energies(30.0, 5.0, 25 / 0.2).total_kwh == pytest.approx(above, rel=1e-9)
    assert above > 0
    little = phase_energies(cancel + 0.3, cancel - 0.2, 0.5 / 0.2).total_kwh
    assert little == pytest.approx(phase_energies(cancel + 0.3, cancel, 0.3 / 0.2).total_kwh)


def test_speeds_may_be_numbers_of_any_kind() -> None:
    """Differences of small unsigned ones would overflow."""
    start, end = np.array([20, 5], dtype=np.uint8), np.array([5, 20], dtype=np.uint8)
    seconds = np.array([200, 20], dtype=np.uint8)
    found = phase_energies(start, end, seconds)
    wanted = phase_energies([20.0, 5.0], [5.0, 20.0], [200.0, 20.0])
    assert [part.tolist() for part in found] == [part.tolist() for part in wanted]
    trace = np.array([20, 5, 7, 200], dtype=np.uint8)
    assert trace_energy(trace, 10.0) == trace_energy(trace.astype(float), 10.0)
    assert wheel_power_w(np.uint8(200), np.uint8(1)) == wheel_power_w(200.0, 1.0)


def test_a_trajectory_needs_what_its_own_vehicle_needs() -> None:
    """In the whole and in its parts, by samples as in closed form; however slowly it creeps."""
    van = VehicleParameters(mass_kg=3500.0, drag_coefficient=0.4, frontal_area_m2=5.0)
    sampled = trace_energy(np.linspace(5.0, 15.0, 2001), 0.01, 0.2, van)
    exact = phase_energies(5.0, 15.0, 20.0, 0.2, van)
    assert list(sampled) == pytest.approx([float(part) for part in exact], rel=1e-5)
    kinetic = van.electrical_kwh(0.5 * 3500.0 * (15.0**2 - 5.0**2))
    assert sampled.acceleration_kwh == pytest.approx(kinetic, rel=1e-9)
    creeping = trace_energy([0.001, 0.001], 1.0)
    assert creeping.rolling_kwh == pytest.approx(
        PAPER_CAR.electrical_kwh(PAPER_CAR.rolling_force_n * 0.001)
    )


def test_a_stack_is_as_wide_as_its_longest_row() -> None:
    """NaN behind the others; no trajectories are no rows."""
    stack = stack_traces([[1, 2, 3], [4]])
    assert stack.dtype == np.float64
    assert np.array_equal(stack, [[1, 2, 3], [4, np.nan, np.nan]], equal_nan=True)
    assert stack_traces([]).shape == (0, 0)


def test_a_phase_of_no_duration_needs_nothing() -> None:
    """Not even where its speeds differ."""
    nothing = phase_energies([0.0, 5.0], [10.0, 5.0], [0.0, 0.0])
    assert [part.tolist() for part in nothing] == [[0.0, 0.0]] * 4


@given(*[st.tuples(*[st.floats(0.0, 9.0)] * 3) for _ in range(3)])
def test_the_parts_of_a_saving_add_up(
    baseline: tuple[float, float, float],
    alone: tuple[float, float, float],
    driven: tuple[float, float, float],
) -> None:
    """Distance, drag and acceleration sum to the whole saving, whatever the drives."""
    saving = split_saving(*(Energy(sum(parts), *parts) for parts in (baseline, alone, driven)))
    assert saving.total_kwh == pytest.approx(sum(baseline) - sum(driven), abs=1e-12)
    parts = saving.distance_kwh + saving.drag_kwh + saving.acceleration_kwh
    assert parts == pytest.approx(saving.total_kwh, abs=1e-12)


def test_each_part_of_a_saving_has_its_own_cause() -> None:
    """A shorter way counts as distance, drafting as drag, and calmer driving as acceleration."""
    calm = np.full(101, 15.0)
    rough = np.clip(15.0 + np.cumsum(np.tile([1.0, -1.0], 51))[:101], 15.0, 16.0)
    base, short = trace_energy(calm, 1.0), trace_energy(calm[:51], 1.0)
    drafted = trace_energy(calm, 1.0, ETA_FOLLOWER)
    assert split_saving(base, short, short).distance_kwh == pytest.approx(base.total_kwh / 2)
    assert split_saving(base, short, short).acceleration_kwh == pytest.approx(0, abs=1e-12)
    assert split_saving(base, base, drafted).drag_kwh == pytest.approx(0.2 * base.drag_kwh)
    assert split_saving(base, base, drafted).distance_kwh == 0
    calmer = split_saving(trace_energy(rough, 1.0), base, base)
    assert calmer.acceleration_kwh > 0.9 * calmer.total_kwh


def test_a_stop_costs_51_wh_at_13_4_mps_and_grows_with_the_square_of_speed() -> None:
    """The kinetic energy that braking loses, as electrical energy."""
    assert stop_energy_kwh(13.4) * 1e3 == pytest.approx(51.0, abs=0.1)
    assert stop_energy_kwh(26.8) == pytest.approx(4 * stop_energy_kwh(13.4))
    heavy = VehicleParameters(mass_kg=3600.0)
    assert stop_energy_kwh(13.4, heavy) == pytest.approx(2 * stop_energy_kwh(13.4))


REGENERATIVE = VehicleParameters(recuperation_efficiency=0.6)


def test_braking_recovers_its_share_of_the_work_at_the_wheels() -> None:
    """By hand: a stop from 20 m/s within 10 s."""
    # ½·1800·20² = 360 kJ of kinetic energy. Rolling over 100 m: 1800·9.81·0.012·100 = 21.19 kJ.
    # Drag 0.441 v², v falling linearly: 0.441·20⁴/(4·2) = 8.82 kJ. The brakes take the rest.
    braked_kj = 360 - 1800 * 9.81 * 0.012 * 0.1 - 0.441 * 20**4 / 8 / 1e3
    phase = phase_energies(20.0, 0.0, 10.0, vehicle=REGENERATIVE)
    assert float(phase.total_kwh) == pytest.approx(-0.6 * braked_kj / 3600, rel=1e-9)
    assert float(phase.rolling_kwh) == float(phase.drag_kwh) == 0.0
    sampled = trace_energy(np.linspace(20.0, 0.0, 1001), 0.01, vehicle=REGENERATIVE)
    assert sampled.total_kwh == pytest.approx(-0.6 * braked_kj / 3600, rel=1e-5)
    assert float(phase_energies(20.0, 0.0, 10.0).total_kwh) == 0.0


@pytest.mark.slow
@given(
    st.lists(st.floats(0.0, 30.0), min_size=2, max_size=6),
    st.floats(0.0, 1.0),
    st.floats(0.0, 0.5),
)
def test_recuperation_is_what_the_paper_leaves_out(
    speeds: list[float], efficiency: float, eta: float
) -> None:
    """Whatever the drive: less by at most the kinetic energy lost, the parts add up, by phases as
    by fine samples.
    """
    vehicle = VehicleParameters(recuperation_efficiency=efficiency)
    v0, v1 = np.array(speeds[:-1]), np.array(speeds[1:])
    seconds = np.full(len(v0), 7.0)
    gross = phase_energies(v0, v1, seconds, eta).sum()
    net = phase_energies(v0, v1, seconds, eta, vehicle).sum()
    lost_j = 0.5 * vehicle.mass_kg * np.maximum(0.0, v0**2 - v1**2).sum()
    recovered = gross.total_kwh - net.total_kwh
    assert -1e-12 <= recovered <= vehicle.recovered_kwh(float(lost_j)) + 1e-12
    assert net.rolling_kwh == gross.rolling_kwh
    assert net.drag_kwh == gross.drag_kwh
    parts = net.rolling_kwh + net.drag_kwh + net.acceleration_kwh
    assert parts == pytest.approx(net.total_kwh, abs=1e-12)
    fine = [np.linspace(a, b, 701) for a, b in zip(v0, v1, strict=True)]
    sampled = trace_energies(np.array(fine), 0.01, eta, vehicle).sum()
    assert sampled.total_kwh == pytest.approx(net.total_kwh, rel=1e-3, abs=1e-5)


def test_stops_and_decelerations_give_back_what_is_recuperated() -> None:
    """By hand: 180 kJ less 60 % of it; a force that brakes 100 m is worth its 60 %."""
    kinetic_j = 0.5 * 1800 * 200
    speed = math.sqrt(200)
    assert stop_energy_kwh(speed, REGENERATIVE) == pytest.approx(
        kinetic_j * (1 / 0.88 - 0.6) / 3.6e6
    )
    force_n = -1800.0 + 1800 * 9.81 * 0.012 + 0.441 * 200
    steady = steady_energy_kwh(100.0, speed, mean_acceleration_mps2=-1.0, vehicle=REGENERATIVE)
    assert steady == pytest.approx(0.6 * force_n * 100 / 3.6e6)
    assert steady_energy_kwh(100.0, speed, mean_acceleration_mps2=-1.0) == 0.0


@pytest.mark.parametrize("efficiency", [-0.1, 1.01, math.nan])
def test_a_recuperation_efficiency_is_a_share(efficiency: float) -> None:
    """Of the work, so between nothing and all of it."""
    with pytest.raises(ValueError, match="recuperation_efficiency"):
        VehicleParameters(recuperation_efficiency=efficiency)
