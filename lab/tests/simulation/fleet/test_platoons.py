"""Real agents form platoons in SUMO, on a straight road of two lanes and nobody else."""

from __future__ import annotations

from pathlib import Path

import libsumo
import pytest

from lab.tests.simulation.fleet.road import LIMIT_MPS, Running, plan, running, segments, write_line
from slipstream.vehicle_types import PRESETS
from slipstream_lab.simulation.fleet.actuation import ALONE, CLOSE
from slipstream_lab.simulation.fleet.brakes import Reality

pytestmark = pytest.mark.slow

CLOSE_M = 7.5


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A straight road."""
    return write_line(tmp_path_factory.mktemp("line"))


def send(
    town: Running, *departures_s: float, path: str = "abc", limit_mps: float = LIMIT_MPS
) -> tuple[str, ...]:
    """A platoon of so many vehicles, planned to set out so."""
    names = tuple(f"v{number}" for number in range(len(departures_s)))
    for place, (name, depart_s) in enumerate(zip(names, departures_s, strict=True)):
        town.exchange.send_plan(
            plan(segments(path, 0, place, limit_mps), vehicle=name, depart_s=depart_s).model_copy(
                update={"issued_ns": 0}
            )
        )
    return names


def open_gates(town: Running, names: str = "abc") -> None:
    """Segments are told to be stable."""
    town.flags.y_e = dict.fromkeys(names, 1)


def is_close(town: Running, names: tuple[str, ...]) -> bool:
    """Whether each but one vehicle follows another one of the fleet in a close gap."""
    gaps = [town.gap_m(name) for name in names if name in town.exchange.sensed]
    return sum(gap is not None and gap <= CLOSE_M for gap in gaps) == len(names) - 1


@pytest.mark.parametrize(
    ("step_s", "low_m", "high_m", "count"), [(0.1, 1.3, 2.3, 2), (0.5, 2.1, 3.3, 3)]
)
def test_a_platoon_forms_and_keeps_its_gap(
    files: tuple[Path, Path], step_s: float, low_m: float, high_m: float, count: int
) -> None:
    """All come onto one lane, by ordinary brakes the wanted gap is kept, drag reductions are
    credited, and SUMO's own check holds back a step or two at most.
    """
    with running(files, [f"v{n}" for n in range(count)], step_s=step_s) as town:
        open_gates(town)
        names = send(town, *[10.0 + n for n in range(count)])
        town.until(lambda: is_close(town, names), limit_s=120.0)
        for _ in town.steps_for(40.0):
            pass
        for _ in town.steps_for(10.0):
            gaps = [town.gap_m(name) for name in names]
            kept = [gap for gap in gaps if gap is not None]
            assert len(kept) == count - 1
            assert all(low_m < gap < high_m for gap in kept)
            lanes = {town.exchange.sensed[name].lane for name in names}
            assert len(lanes) == 1
        town.until(lambda: town.world.tours_finished == count)
    leader, *others = sorted(town.legs, key=lambda leg: leg.followed_m)
    assert leader.led_m > 3000.0
    assert all(leg.followed_m > 3000.0 for leg in others)
    assert all(leg.driven.drag_kwh < leg.alone.drag_kwh for leg in town.legs)
    assert town.collisions == 0
    assert town.world.disengagements == 0
    safety = town.world.safety.found
    assert safety.collisions == 0
    assert safety.held_back <= 2
    assert safety.least_gap_m is not None
    assert low_m - 0.2 < safety.least_gap_m < high_m


def test_ideal_vehicles_keep_the_advised_gap(files: tuple[Path, Path]) -> None:
    """The paper's vehicle is one profile: it drives what it is advised, in the same step."""
    ideal = Reality.of_day(PRESETS["paper_car"], "dry", ideal=True, seed=1)
    with running(files, ["v0", "v1"], step_s=0.1, reality=ideal) as town:
        open_gates(town)
        names = send(town, 10.0, 11.0)
        town.until(lambda: is_close(town, names), limit_s=90.0)
        for _ in town.steps_for(40.0):
            pass
        for _ in town.steps_for(10.0):
            follower = min(names, key=lambda name: town.gap_m(name) or 1e9)
            told = town.exchange.advised[follower].speed_mps
            assert libsumo.vehicle.getSpeed(f"cav/{follower}/0/0") == pytest.approx(told)
        assert 1.9 < (town.gap_m(follower) or 0.0) < 2.1
    assert town.collisions == 0


@pytest.mark.parametrize(
    ("step_s", "apart_s", "first"), [(0.5, 0.1, 0), (0.5, 2.5, 0), (0.5, 2.5, 1), (0.1, 1.0, 1)]
)
def test_members_that_set_out_apart_within_the_window_are_one_platoon(
    files: tuple[Path, Path], step_s: float, apart_s: float, first: int
) -> None:
    """The synchronisation window is 3 s: whoever is on the road first, they come together."""
    with running(files, ["v0", "v1"], step_s=step_s) as town:
        open_gates(town)
        departures = (10.0, 10.0 + apart_s) if first == 0 else (10.0 + apart_s, 10.0)
        names = send(town, *departures)
        town.until(lambda: is_close(town, names), limit_s=90.0)
        town.until(lambda: town.world.tours_finished == 2)
    assert sum(leg.followed_m for leg in town.legs) > 3000.0
    assert town.collisions == 0


@pytest.mark.parametrize("apart_s", [0.1, 2.5])
def test_on_a_citys_road_of_two_lanes_a_planned_platoon_forms_too(
    tmp_path: Path, apart_s: float
) -> None:
    """Who comes onto the other lane falls back and changes lanes, as the plan has it behind."""
    with running(write_line(tmp_path, 13.9), ["v0", "v1"]) as town:
        open_gates(town)
        names = send(town, 10.0, 10.0 + apart_s, limit_mps=13.9)
        town.until(lambda: is_close(town, names), limit_s=90.0)
    assert town.collisions == 0


def test_a_platoon_parts_before_a_closed_gate(files: tuple[Path, Path]) -> None:
    """Nobody is close on the closed segment, none brakes hard, and the driver's type is back."""
    with running(files, ["v0", "v1"], step_s=0.5) as town:
        open_gates(town, "a")
        names = send(town, 10.0, 11.0)
        town.until(lambda: is_close(town, names), limit_s=90.0)
        hardest = 0.0
        while town.exchange.sensed[names[0]].segment == "a":
            town.step()
            hardest = min(
                hardest, *(town.exchange.sensed[name].acceleration_mps2 for name in names)
            )
        assert not is_close(town, names)
        assert hardest > -2.6
        town.until(lambda: all(town.exchange.sensed[name].segment == "b" for name in names))
        for _ in town.steps_for(20.0):
            assert not is_close(town, names)
        kinds = {libsumo.vehicle.getTypeID(name) for name in libsumo.vehicle.getIDList()}
        assert kinds == {ALONE}
        town.until(lambda: town.world.tours_finished == 2)
    assert 1000.0 < sum(leg.followed_m for leg in town.legs) < 3000.0
    assert town.world.disengagements == 0


@pytest.mark.parametrize("count", [2, 3])
def test_turbulence_parts_a_platoon_at_once_and_is_counted(
    files: tuple[Path, Path], count: int
) -> None:
    """The gap opens from the next word of the RSU on; what was close meanwhile was exposed. A
    platoon counts once, whatever its length."""
    with running(files, [f"v{n}" for n in range(count)], step_s=0.5) as town:
        open_gates(town)
        names = send(town, *[10.0 + n for n in range(count)])
        town.until(lambda: is_close(town, names), limit_s=90.0)
        town.flags.y_e["a"] = 0
        for _ in town.steps_for(2.0):
            pass
        modes = {town.exchange.advised[name].mode for name in names}
        assert modes - {"speed"} <= {"open_gap", "cruise"}
        assert town.world.disengagements == 1
        town.until(lambda: town.world.tours_finished == count)
    assert town.world.disengagements == 1
    assert all(leg.turbulent_s > 0 for leg in town.legs)
    assert town.collisions == 0


def test_a_follower_whose_agent_falls_silent_is_its_drivers_and_opens_the_gap(
    files: tuple[Path, Path],
) -> None:
    """No advice in a close gap: it brakes as the last one says until the gap is its driver's, whose
    car-following is back then.
    """
    with running(files, ["v0", "v1"], step_s=0.1) as town:
        open_gates(town)
        names = send(town, 10.0, 11.0)
        town.until(lambda: is_close(town, names), limit_s=90.0)
        for _ in town.steps_for(10.0):
            pass
        rear = min(names, key=lambda name: town.gap_m(name) or 1e9)
        sumo = f"cav/{rear}/0/0"
        assert libsumo.vehicle.getTypeID(sumo) == CLOSE
        town.exchange.silent.add(rear)
        hardest = min(libsumo.vehicle.getAcceleration(sumo) for _ in town.steps_for(3.0))
        assert hardest == pytest.approx(-2.5, rel=0.06)
        town.until(lambda: libsumo.vehicle.getTypeID(sumo) == ALONE, limit_s=20.0)
        gap_m = town.gap_m(rear)
        assert gap_m is not None
        assert gap_m > 20.0
    assert town.collisions == 0
    assert town.world.safety.found.held_back == 0
