"""Platoons in SUMO, on a road of three segments with two lanes and nobody else."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import libsumo
import pytest

from simulation.controllers.platooning import Platooning, road
from simulation.controllers.platooning.controller import PlatoonStep
from simulation.controllers.vehicle import LegOrder, read_state
from simulation.scenarios.scenario import load_scenario
from simulation.sumo.session import Session
from simulation.sumo.vehicle_types import TYPES
from slipstream.energy import ETA_FOLLOWER, ETA_LEADER
from slipstream.messages import DrivingAdvice

LENGTHS = {"a": 3000.0, "b": 1500.0, "c": 1000.0}
LIMIT = 30.0
LEAD, REAR = "cav/lead/0/0", "cav/rear/0/0"


def write_net(folder: Path) -> Path:
    """Three segments in a line."""
    lines, begin = [], 0.0
    ends = {"a": "01", "b": "12", "c": "23"}
    for name, length in LENGTHS.items():
        lanes = "".join(
            f'<lane id="{name}_{i}" index="{i}" speed="{LIMIT}" length="{length}" '
            f'shape="{begin},{3.2 * i} {begin + length},{3.2 * i}"/>'
            for i in range(2)
        )
        one, other = tuple(ends[name])
        lines.append(f'<edge id="{name}" from="{one}" to="{other}" priority="1">{lanes}</edge>')
        begin += length
    at = 0.0
    for number, length in enumerate([0.0, *LENGTHS.values()]):
        at += length
        kind = "dead_end" if number in (0, 3) else "priority"
        before = ["", "a_0 a_1", "b_0 b_1", "c_0 c_1"][number]
        request = '<request index="0" response="00" foes="00"/>'
        request += '<request index="1" response="00" foes="00"/>'
        lines.append(
            f'<junction id="{number}" type="{kind}" x="{at}" y="0" incLanes="{before}" '
            f'intLanes="" shape="{at},0 {at},6">{request if kind == "priority" else ""}</junction>'
        )
    for one, other in (("a", "b"), ("b", "c")):
        lines += (
            f'<connection from="{one}" to="{other}" fromLane="{lane}" toLane="{lane}" '
            'dir="s" state="M"/>'
            for lane in range(2)
        )
    path = folder / "line.net.xml"
    path.write_text(
        f'<net version="1.20"><location netOffset="0,0" convBoundary="0,0,{begin},10" '
        'origBoundary="0,0,1,1" projParameter="!"/>' + "".join(lines) + "</net>"
    )
    return path


@dataclass
class Drive:
    """What happened, step by step.

    Attributes:
        steps: what platooning said.
        speeds: by vehicle.
        gaps: of the rear vehicle to the front one, driven distances apart.
        places: of the rear one's front along the whole road.
        collisions: counted.
        disengagements: counted.
        types: of the rear vehicle.
    """

    steps: list[PlatoonStep] = field(default_factory=list)
    speeds: dict[str, list[float]] = field(default_factory=dict)
    gaps: list[float] = field(default_factory=list)
    places: list[float] = field(default_factory=list)
    types: list[str] = field(default_factory=list)
    collisions: int = 0
    disengagements: int = 0


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Net and route file."""
    folder = tmp_path_factory.mktemp("line")
    routes = folder / "line.rou.xml"
    routes.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    return write_net(folder), routes


def drive(
    files: tuple[Path, Path],
    *,
    step_s: float = 0.5,
    seconds: float = 60.0,
    gap_m: float = 45.0,
    speed_mps: float = 28.0,
    is_open: Callable[[str], bool] = lambda segment: True,
    is_turbulent: Callable[[str], bool] = lambda segment: False,
    enabled: bool = True,
    paths: Mapping[str, str] | None = None,
    lead_command: Callable[[float], float | None] = lambda now: None,
    between: bool = False,
    rear_lane: int = 0,
) -> Drive:
    """Two vehicles, another one between if so, the caps set as the world sets them."""
    net, routes = files
    found, vehicle = Drive(), libsumo.vehicle
    options = [
        *("--net-file", str(net), "--route-files", str(routes), "--step-length", f"{step_s:g}"),
        *("--xml-validation", "never", "--no-warnings", "true", "--no-step-log", "true"),
        *("--collision.action", "warn", "--default.speeddev", "0"),
    ]
    platooning = Platooning(is_open, is_turbulent, step_s, LENGTHS, enabled)
    with Session(options, (net, routes)) as session:
        orders = {}
        for name, begin_m in ((LEAD, 100.0 + gap_m + 4.6), (REAR, 100.0)):
            path = tuple((paths or {}).get(name, "abc"))
            libsumo.route.add(name, list(path))
            lane = str(rear_lane if name == REAR else 0)
            vehicle.add(
                name, name, "cav", "now", lane, f"{begin_m}", f"{speed_mps}", arrivalSpeed="0"
            )
            orders[name] = LegOrder(name, 0, 0, path, 0.0, 0.0, 1.0, (), DrivingAdvice())
        if between:
            middle_m = f"{100.0 + gap_m / 2 + 2.3}"
            vehicle.add("other", LEAD, "cav", "now", "0", middle_m, f"{speed_mps}")
        session.advance()
        for name, order in orders.items():
            platooning.departed(name, order)
            found.speeds[name] = []
        begin_m = vehicle.getDistance(REAR)
        while session.time_s < seconds and {LEAD, REAR} <= set(vehicle.getIDList()):
            states = {name: read_state(name, order) for name, order in orders.items()}
            step = platooning.step(session.time_s, states)
            for name in orders:
                commanded = lead_command(session.time_s) if name == LEAD else None
                cap = commanded if commanded is not None else step.caps.get(name, -1)
                vehicle.setSpeed(name, cap)
            session.advance()
            found.collisions += libsumo.simulation.getCollidingVehiclesNumber()
            if not {LEAD, REAR} <= set(vehicle.getIDList()):
                break
            found.steps.append(step)
            for name in orders:
                found.speeds[name].append(vehicle.getSpeed(name))
            found.places.append(100.0 + vehicle.getDistance(REAR) - begin_m)
            found.gaps.append(_along(LEAD) - _along(REAR) - 4.6)
            found.types.append(vehicle.getTypeID(REAR))
        found.disengagements = platooning.disengagements
    return found


def _along(name: str) -> float:
    before = {"a": 0.0, "b": LENGTHS["a"], "c": LENGTHS["a"] + LENGTHS["b"]}
    return float(before[libsumo.vehicle.getRoadID(name)] + libsumo.vehicle.getLanePosition(name))


def hardest(speeds: list[float], step_s: float = 0.5) -> float:
    """Largest deceleration, m/s²."""
    return max((s - t) / step_s for s, t in pairwise(speeds))


def test_a_platoon_holds_one_to_two_metres_at_steps_of_a_tenth(files: tuple[Path, Path]) -> None:
    """At 0.1 s the gap is the one that drag reductions are credited for, and stays it."""
    found = drive(files, step_s=0.1, seconds=75.0)
    last = found.gaps[-100:]
    assert 1.0 < min(last) <= max(last) < 2.0
    assert found.steps[-1].eta == {LEAD: ETA_LEADER, REAR: ETA_FOLLOWER}
    assert found.steps[-1].follows == {REAR}
    assert found.steps[-1].leads == {LEAD}
    assert found.steps[-1].tail_m[LEAD] == pytest.approx(9.2 + last[-1], abs=0.1)
    assert found.collisions == 0


def test_a_platoon_stays_together_when_its_leader_brakes(files: tuple[Path, Path]) -> None:
    """At 0.5 s, through braking at 2.5 m/s² to a third of the speed and back, nobody touches."""

    def commanded(now: float) -> float | None:
        return 10.0 if 45 <= now < 60 else None

    found = drive(files, seconds=90.0, lead_command=commanded)
    together = found.gaps[80:]
    assert 1.5 < min(together) <= max(together) < 7.5
    assert found.collisions == 0
    assert hardest(found.speeds[REAR]) < 4.6
    assert REAR in found.steps[-1].eta


def test_a_platoon_parts_before_the_gate_that_is_closed(files: tuple[Path, Path]) -> None:
    """Nothing is credited there, the gap is wide at the border, and nobody brakes hard for it."""
    found = drive(files, seconds=130.0, is_open=lambda segment: segment != "b")
    credited = [place for place, step in zip(found.places, found.steps, strict=True) if step.eta]
    assert credited
    assert max(credited) < LENGTHS["a"]
    before = [gap for place, gap in zip(found.places, found.gaps, strict=True) if place < 3000]
    assert before[-1] > 15.0
    assert hardest(found.speeds[REAR]) < 0.6
    assert found.types[-1] == "cav"


def test_a_leader_beyond_a_gate_that_has_just_closed_is_not_credited(
    files: tuple[Path, Path],
) -> None:
    """From the step on in which the gate of its segment closes."""
    on_b: list[bool] = []

    def read_contacts(_: float) -> None:
        on_b.append(libsumo.vehicle.getRoadID(LEAD) == "b")

    found = drive(
        files,
        step_s=0.1,
        seconds=115.0,
        is_open=lambda segment: segment != "b" or not any(on_b),
        lead_command=read_contacts,
    )
    closes = on_b.index(True)
    assert found.steps[closes].eta == {LEAD: ETA_LEADER, REAR: ETA_FOLLOWER}
    assert found.places[closes] < LENGTHS["a"]
    assert not any(LEAD in step.eta for step in found.steps[closes + 1 :])


def test_turbulence_behind_an_open_gate_parts_a_platoon_once(files: tuple[Path, Path]) -> None:
    """The platoon is counted, exposed while it opens its gap, and does not form again there."""
    found = drive(files, seconds=150.0, is_turbulent=lambda segment: segment == "b")
    assert found.disengagements == 1
    exposed = [step.turbulent for step in found.steps if step.turbulent]
    assert {LEAD, REAR} in exposed
    on_b = [i for i, place in enumerate(found.places) if 3000 < place < 4500]
    assert not any(found.steps[i].eta for i in on_b[1:])
    assert hardest(found.speeds[REAR]) < 0.6


def test_vehicles_apart_come_together(files: tuple[Path, Path]) -> None:
    """The front one waits, the rear one hurries, neither by more than stated; then both draft."""
    found = drive(files, seconds=120.0, gap_m=150.0)
    assert max(found.speeds[REAR]) <= 1.05 * LIMIT + 1e-6
    assert min(found.speeds[LEAD]) >= 0.9 * LIMIT - 1e-6
    assert found.steps[10].speed_scale[REAR] == pytest.approx(1.05)
    assert REAR in found.steps[-1].eta
    assert hardest(found.speeds[LEAD]) < 0.4


def test_whoever_drives_between_is_overtaken_on_a_motorway(files: tuple[Path, Path]) -> None:
    """A car as fast as both is passed by the one who hurries, and left behind by nobody else."""
    found = drive(files, seconds=150.0, gap_m=100.0, between=True)
    assert found.steps[-1].eta == {LEAD: ETA_LEADER, REAR: ETA_FOLLOWER}
    assert found.collisions == 0
    apart = drive(files, seconds=150.0, gap_m=100.0, between=True, enabled=False)
    assert min(apart.gaps) > 70.0


@pytest.mark.parametrize("gap_m", [4.0, 20.0])
def test_vehicles_side_by_side_come_onto_one_lane(files: tuple[Path, Path], gap_m: float) -> None:
    """The rear one drops back until there is room behind the other one."""
    found = drive(files, seconds=150.0, gap_m=gap_m, rear_lane=1)
    assert found.steps[-1].eta == {LEAD: ETA_LEADER, REAR: ETA_FOLLOWER}
    assert hardest(found.speeds[LEAD]) < 0.6
    assert hardest(found.speeds[REAR]) < 2.0  # comfortable
    assert found.collisions == 0


def test_vehicles_that_soon_part_stay_apart(files: tuple[Path, Path]) -> None:
    """A common way that ends before it would pay changes nothing."""
    found = drive(files, seconds=20.0, gap_m=120.0, is_open=lambda segment: False)
    assert not any(step.caps or step.speed_scale or step.eta for step in found.steps)


def test_an_arm_without_platoons_is_left_alone(files: tuple[Path, Path]) -> None:
    """Disabled, nothing is said and nothing is set."""
    found = drive(files, seconds=20.0, gap_m=60.0, enabled=False)
    assert all(step == PlatoonStep() for step in found.steps)
    assert set(found.types) == {"cav"}


def test_the_same_drive_twice_is_the_same(files: tuple[Path, Path]) -> None:
    """Same vehicles, same speeds to the last bit."""
    one, other = (drive(files, seconds=30.0) for _ in range(2))
    assert one.speeds == other.speeds


def test_no_van_is_sent_onto_a_lane_that_ends(tmp_path: Path) -> None:
    """Where a ramp has joined the motorway, its lane ends; the others lead on."""
    net = load_scenario("corridor").net
    routes = tmp_path / "one.rou.xml"
    routes.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    options = ["--net-file", str(net), "--route-files", str(routes), "--no-step-log", "true"]
    with Session(options, (net, routes)) as session:
        libsumo.route.add("on", ["e3_join", "e3_main"])
        libsumo.vehicle.add("van", "on", "cav", "now", "1", "10", "20")
        session.advance()
        assert libsumo.vehicle.getRoadID("van") == "e3_join"
        assert [road.lane_continues("van", lane) for lane in range(3)] == [False, True, True]
