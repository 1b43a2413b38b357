"""Signals give green to who asks, keep every yellow and least green, and come back into step."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from simulation.controllers.signals.priority_rules import (
    EndPhase,
    ExtendPhase,
    PrioritySettings,
    decide,
)
from simulation.controllers.signals.program import Phase, Program
from simulation.controllers.vehicle import LegOrder, free_drive_s, read_state
from simulation.scenarios.networks.fixed_time import write_fixed_time
from simulation.scenarios.scenario import load_scenario
from simulation.sumo.session import Session
from simulation.sumo.vehicle_types import TYPES
from slipstream.messages import DrivingAdvice

libsumo = pytest.importorskip("libsumo")

PROGRAM = Program(
    (
        Phase("Gr", 30.0, 8.0, (1,)),
        Phase("yr", 3.0, 3.0, (2,)),
        Phase("rG", 30.0, 8.0, (3,)),
        Phase("ry", 3.0, 3.0, (0,)),
    ),
    True,
)


def _decide(
    phase: int, link: int, *, wanted_s: float, through_s: float
) -> ExtendPhase | EndPhase | None:
    """A phase that began at 100 and ends at 130; greens are held to 145 at most."""
    return decide(PROGRAM, phase, 100.0, 130.0, link, wanted_s, through_s, 145.0)


def test_a_green_is_held_only_if_it_is_needed_and_within_its_limit() -> None:
    """Through before its end: nothing; after it: held until then; too long: nothing."""
    assert _decide(0, 0, wanted_s=115.0, through_s=130.0) is None
    assert _decide(0, 0, wanted_s=125.0, through_s=134.0) == ExtendPhase(134.0)
    assert _decide(0, 0, wanted_s=140.0, through_s=146.0) is None


def test_a_phase_is_cut_no_earlier_than_needed_and_after_its_least_time() -> None:
    """Green with the vehicle's arrival, yellow before it, and no green of less than 8 s."""
    assert _decide(0, 1, wanted_s=120.0, through_s=128.0) == EndPhase(117.0)
    assert _decide(0, 1, wanted_s=90.0, through_s=98.0) == EndPhase(108.0)
    assert _decide(0, 1, wanted_s=133.0, through_s=140.0) is None


def test_yellow_is_never_changed() -> None:
    """While a junction is cleared there is nothing to decide."""
    assert _decide(1, 0, wanted_s=100.0, through_s=160.0) is None
    assert _decide(1, 1, wanted_s=100.0, through_s=160.0) is None


def test_a_free_drive_is_that_of_constant_acceleration_up_to_the_limit() -> None:
    """10 s from rest to 18 m/s take 90 m; each further 18 m another second."""
    assert free_drive_s(90.0, 0.0, 18.0) == pytest.approx(10.0)
    assert free_drive_s(108.0, 0.0, 18.0) == pytest.approx(11.0)
    assert free_drive_s(36.0, 20.0, 18.0) == pytest.approx(2.0)
    assert free_drive_s(22.5, 0.0, 18.0) == pytest.approx(5.0)


@pytest.mark.slow
@pytest.mark.parametrize("waiting", [0, 1])
def test_no_green_is_cut_where_the_streets_that_lose_it_are_full(
    tmp_path: Path, waiting: int
) -> None:
    """With nobody on the cross street a signal turns early, with one vehicle there it does not."""
    from simulation.controllers.signals.priority import Priority
    from simulation.controllers.signals.timing import Signals

    order = LegOrder(
        "v", 0, 0, PATH, 25200.0, 25200.0, 60.0, (), DrivingAdvice(signal_priority=True)
    )
    with _troy(tmp_path, fixed=True) as session:
        priority = Priority(Signals(), True, PrioritySettings(max_losing=0))
        # The cross street's green begins at 25280, before the vehicle comes near.
        session.advance(25270.0)
        libsumo.route.add(order.id, PATH)
        libsumo.vehicle.add(order.id, order.id, typeID="cav", departSpeed="0")
        libsumo.route.add("cross", ["hoosick_15th-hoosick_10th", "hoosick_10th-hoosick_8th"])
        if waiting:
            libsumo.vehicle.add("other", "cross", departSpeed="0")
            libsumo.vehicle.setSpeed("other", 0.0)
        session.advance()
        priority.departed(order.id, order)
        state = read_state(order.id, order)
        while state.number == 0 and not state.crossing:
            if waiting and "other" not in libsumo.vehicle.getIDList():
                libsumo.vehicle.add("other", "cross", departSpeed="0")
            priority.step(session.time_s, {order.id: state})
            session.advance()
            state = read_state(order.id, order)
        assert priority.counts.early_greens == 1 - waiting


def test_settings_out_of_range_are_refused() -> None:
    """Times are not negative."""
    with pytest.raises(ValueError, match="signal priority"):
        PrioritySettings(lead_s=-1.0)


PATH = (
    *("10th_oakwood-hoosick_10th", "hoosick_10th-hoosick_8th", "hoosick_8th-hoosick_6th"),
    *("hoosick_6th-hoosick_5th", "hoosick_5th-hoosick_river", "hoosick_river-king_river"),
)


def _troy(folder: Path, fixed: bool) -> Session:
    """Troy's roads at seven with nobody on them."""
    net = load_scenario("troy").net
    types = folder / "types.rou.xml"
    types.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    options = ["--net-file", str(net), "--route-files", str(types), "--step-length", "0.5"]
    options += ["--no-step-log", "true", "--no-warnings", "true", "--begin", "25200"]
    if fixed:
        write_fixed_time(net, folder / "fixed.add.xml")
        options += ["--additional-files", str(folder / "fixed.add.xml")]
    return Session(options, (net, types))


@dataclass(frozen=True)
class Driven:
    """A drive over five signals of Troy, alone, and three cycles of nobody behind it.

    Attributes:
        served: signals that did something for it.
        travel_s: of the drive.
        states: of each signal on the way at each step.
    """

    served: int
    travel_s: float
    states: dict[str, list[str]]


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[bool, bool], Driven]:
    """By whether times are fixed and whether priority is given."""
    folder = tmp_path_factory.mktemp("drives")
    cases = [(fixed, enabled) for fixed in (True, False) for enabled in (True, False)]
    return {case: _drive(folder, *case) for case in cases}


def _drive(folder: Path, fixed: bool, enabled: bool) -> Driven:
    from simulation.controllers.signals.crossings import Movements
    from simulation.controllers.signals.priority import Priority
    from simulation.controllers.signals.timing import Signals

    order = LegOrder(
        "v", 0, 0, PATH, 25200.0, 25200.0, 60.0, (), DrivingAdvice(signal_priority=True)
    )
    states: dict[str, list[str]] = {}
    with _troy(folder, fixed) as session:
        priority = Priority(Signals(), enabled)
        watched = [crossing.tls for crossing in Movements().crossings(PATH)]
        libsumo.route.add(order.id, PATH)
        libsumo.vehicle.add(order.id, order.id, typeID="cav", departSpeed="0")
        session.advance()
        priority.departed(order.id, order)
        arrived_s, end_s = 0.0, float("inf")
        while session.time_s < end_s:
            running = order.id in libsumo.vehicle.getIDList()
            if not running and not arrived_s:
                arrived_s, end_s = session.time_s, session.time_s + 240.0
                priority.ended(order.id)
            known = {order.id: read_state(order.id, order)} if running else {}
            priority.step(session.time_s, known)
            session.advance()
            for tls in watched:
                state = libsumo.trafficlight.getRedYellowGreenState(tls)
                states.setdefault(tls, []).append(state)
        return Driven(priority.counts.served, arrived_s - 25200.0, states)


def _shortest_s(states: list[str], letters: str) -> float:
    """The shortest time that a movement shows one of some letters; the ends left out, s."""
    lasted = [1e9]
    for shown in zip(*states, strict=True):
        since = None
        for step in range(1, len(shown)):
            if (shown[step] in letters) != (shown[step - 1] in letters):
                if shown[step] in letters:
                    since = step
                elif since is not None:
                    lasted.append((step - since) / 2)
    return min(lasted)


@pytest.mark.slow
@pytest.mark.parametrize("fixed", [True, False])
def test_who_asks_is_sooner_through_and_no_yellow_is_shortened(
    drives: dict[tuple[bool, bool], Driven], fixed: bool
) -> None:
    """The drive is quicker than without priority; yellows and least greens keep their times."""
    given, refused = drives[fixed, True], drives[fixed, False]
    assert (given.served > 0, refused.served) == (True, 0)
    assert given.travel_s < refused.travel_s - 5.0
    for tls, shown in given.states.items():
        assert _shortest_s(shown, "y") == _shortest_s(refused.states[tls], "y")
        assert _shortest_s(shown, "Gg") >= (6.0 if fixed else 5.0)
        for before, after in pairwise(shown):
            assert not any(a in "Gg" and b == "r" for a, b in zip(before, after, strict=True))


def test_fixed_times_are_back_in_step_after_a_grant(
    drives: dict[tuple[bool, bool], Driven],
) -> None:
    """Some cycles later every signal shows again what it shows each 80 s since midnight."""
    changed = 0
    for tls, usual in drives[True, False].states.items():
        shown = drives[True, True].states[tls]
        changed += any(a != b for a, b in zip(shown, usual, strict=False))
        steps = range(len(shown) - 160, len(shown))
        assert [shown[step] for step in steps] == [usual[step % 160] for step in steps], tls
    assert changed
