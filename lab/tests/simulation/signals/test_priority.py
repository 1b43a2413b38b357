"""Signals give green to who asks, keep every yellow and least green, and come back into step."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest

from slipstream.messages import SignalRequest, SignalStatus
from slipstream.roads.sumo_net import load_network
from slipstream_lab.simulation.scenarios.networks.fixed_time import write_fixed_time
from slipstream_lab.simulation.scenarios.scenario import load_scenario
from slipstream_lab.simulation.signals import PrioritySettings, SignalController
from slipstream_lab.simulation.sumo.session import SumoSession
from slipstream_lab.simulation.sumo.vehicle_types import TYPES
from vehicle_agent.leg import Leg
from vehicle_agent.signals import SignalRequests, SignalTimings, intersections_ahead

libsumo = pytest.importorskip("libsumo")

PATH = (
    *("10th_oakwood-hoosick_10th", "hoosick_10th-hoosick_8th", "hoosick_8th-hoosick_6th"),
    *("hoosick_6th-hoosick_5th", "hoosick_5th-hoosick_river", "hoosick_river-king_river"),
)


def _troy(folder: Path, fixed: bool) -> SumoSession:
    """Troy's roads at seven with nobody on them."""
    net = load_scenario("troy").net
    types = folder / "types.rou.xml"
    types.write_text(f"<routes>{TYPES['cav'].xml()}</routes>")
    options = ["--net-file", str(net), "--route-files", str(types), "--step-length", "0.5"]
    options += ["--no-step-log", "true", "--no-warnings", "true", "--begin", "25200"]
    if fixed:
        write_fixed_time(net, folder / "fixed.add.xml")
        options += ["--additional-files", str(folder / "fixed.add.xml")]
    return SumoSession(options, (net, types))


@dataclass(frozen=True)
class Driven:
    """A drive over five signals of Troy, alone, and three cycles of nobody behind it.

    Attributes:
        served: signals that did something for it.
        travel_s: of the drive.
        states: of each signal on the way at each step.
        answers: of the signals.
    """

    served: int
    travel_s: float
    states: dict[str, list[str]]
    answers: list[SignalStatus]


class Asking:
    """The vehicle "van" and the signals: what they tell each other at each step."""

    def __init__(self, leg: Leg, controller: SignalController) -> None:
        self.leg, self.controller = leg, controller
        self.answers: list[SignalStatus] = []
        self._timings = SignalTimings()
        self._requests = SignalRequests("van", self._timings)

    def step(self, now_s: float) -> bool:
        """Whether the vehicle is on the road."""
        from lab.tests.simulation.signals.driving import state_of

        running = "van" in libsumo.vehicle.getIDList()
        if running:
            state = state_of("van", self.leg)
            for intersection in intersections_ahead(self.leg, self.leg.place_m(state)):
                self._timings.receive(self.controller.spat(intersection, now_s))
            sent = self._requests.step(now_s, self.leg, state)
        else:
            sent = self._requests.end(now_s)
        for message in sent:
            self.controller.receive(message, now_s)
        self.answers += self.controller.step(now_s)
        return running


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[bool, bool], Driven]:
    """By whether times are fixed and whether priority is given."""
    folder = tmp_path_factory.mktemp("drives")
    cases = [(fixed, enabled) for fixed in (True, False) for enabled in (True, False)]
    return {case: _drive(folder, *case) for case in cases}


def _drive(folder: Path, fixed: bool, enabled: bool) -> Driven:
    from lab.tests.simulation.signals.driving import leg_of

    states: dict[str, list[str]] = {}
    leg = leg_of(load_network(str(load_scenario("troy").net)), PATH)
    with _troy(folder, fixed) as session:
        asking = Asking(leg, SignalController(libsumo.trafficlight.getIDList(), enabled))
        watched = [line.intersection for line in leg.lines]
        libsumo.route.add("van", PATH)
        libsumo.vehicle.add("van", "van", typeID="cav", departSpeed="0")
        session.advance()
        arrived_s, end_s = 0.0, float("inf")
        while session.time_s < end_s:
            if not asking.step(session.time_s) and not arrived_s:
                arrived_s, end_s = session.time_s, session.time_s + 240.0
            session.advance()
            for intersection in watched:
                state = libsumo.trafficlight.getRedYellowGreenState(intersection)
                states.setdefault(intersection, []).append(state)
        return Driven(asking.controller.counts.served, arrived_s - 25200.0, states, asking.answers)


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


def test_each_request_is_answered_and_leaves_the_answers_in_the_end(
    drives: dict[tuple[bool, bool], Driven],
) -> None:
    """Granted where the signal changed its times, rejected where the city gives no priority."""
    by_signal: dict[str, list[str]] = {}
    for answer in drives[True, True].answers:
        by_signal.setdefault(answer.intersection, []).append(
            " ".join(status.status for status in answer.requests)
        )
    assert set(by_signal) == set(drives[True, True].states)
    assert all(told[-1] == "" for told in by_signal.values())
    granted = sum("granted" in told for told in by_signal.values())
    assert granted == drives[True, True].served > 0
    refused = drives[True, False].answers
    assert {status.status for answer in refused for status in answer.requests} == {"rejected"}


def _request(number: int, kind: str, time_s: float, group: int = 2) -> SignalRequest:
    """Of a vehicle that is just at the line; group 2 has green until later."""
    return SignalRequest.model_validate(
        {
            "vehicle": "van",
            "request": number,
            "sequence": number,
            "time_ns": round(time_s * 1e9),
            "intersection": "hoosick_10th",
            "signal_group": group,
            "kind": kind,
            "arrival_ns": round((time_s + 0.5) * 1e9),
            "through_ns": round((time_s + 1.0) * 1e9),
        }
    )


def test_a_request_that_is_not_renewed_lapses_and_a_wrong_one_is_rejected(tmp_path: Path) -> None:
    """Also one for a group that the signal has not; one for another city is left out."""
    with _troy(tmp_path, fixed=True) as session:
        controller = SignalController(["hoosick_10th"], True)
        session.advance(25201.0)

        def heard(*messages: SignalRequest) -> list[tuple[int, str]] | None:
            for message in messages:
                controller.receive(message, session.time_s)
            answers = controller.step(session.time_s)
            session.advance(session.time_s + 1.0)
            if not answers:
                return None
            return [(status.request, status.status) for status in answers[0].requests]

        first = _request(1, "priorityRequest", 25201.0)
        assert heard(first, _request(2, "priorityRequest", 25201.0, 99)) == [
            (1, "processing"),
            (2, "rejected"),
        ]
        assert heard() is None
        assert heard(_request(1, "priorityRequestUpdate", 25203.0)) is None
        assert heard() == [(1, "processing")]
        assert heard(_request(3, "priorityRequestUpdate", 25205.0)) == [
            (1, "processing"),
            (3, "processing"),
        ]
        assert heard(_request(3, "priorityCancellation", 25206.0)) == []
        elsewhere = first.model_copy(update={"intersection": "elsewhere"})
        assert heard(elsewhere) is None
        assert controller.counts.requests == 3


def test_a_request_is_answered_in_the_next_step(tmp_path: Path) -> None:
    """Not only when a second is over."""
    with _troy(tmp_path, fixed=True) as session:
        controller = SignalController(["hoosick_10th"], True)
        session.advance(25201.0)
        assert controller.step(session.time_s) == ()
        controller.receive(_request(1, "priorityRequest", 25201.0), session.time_s)
        session.advance()
        (answer,) = controller.step(session.time_s)
        assert [status.status for status in answer.requests] == ["processing"]
        assert answer.time_ns == 25201_500_000_000


@pytest.mark.slow
@pytest.mark.parametrize("waiting", [0, 1])
def test_no_green_is_cut_where_the_streets_that_lose_it_are_full(
    tmp_path: Path, waiting: int
) -> None:
    """With nobody on the cross street a signal turns early, with one vehicle there it does not."""
    from lab.tests.simulation.signals.driving import leg_of, state_of

    leg = leg_of(load_network(str(load_scenario("troy").net)), PATH)
    with _troy(tmp_path, fixed=True) as session:
        settings = PrioritySettings(max_losing=0)
        every = libsumo.trafficlight.getIDList()
        asking = Asking(leg, SignalController(every, True, settings))
        # The cross street's green begins at 25280, before the vehicle comes near.
        session.advance(25270.0)
        libsumo.route.add("van", PATH)
        libsumo.vehicle.add("van", "van", typeID="cav", departSpeed="0")
        libsumo.route.add("cross", ["hoosick_15th-hoosick_10th", "hoosick_10th-hoosick_8th"])
        if waiting:
            libsumo.vehicle.add("other", "cross", departSpeed="0")
            libsumo.vehicle.setSpeed("other", 0.0)
        session.advance()
        state = state_of("van", leg)
        while state.number == 0 and not state.crossing:
            if waiting and "other" not in libsumo.vehicle.getIDList():
                libsumo.vehicle.add("other", "cross", departSpeed="0")
            asking.step(session.time_s)
            session.advance()
            state = state_of("van", leg)
        assert asking.controller.counts.early_greens == 1 - waiting
