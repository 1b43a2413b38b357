"""Messages in one process: each reaches those that it is for, and nobody else."""

from __future__ import annotations

from pathlib import Path

import pytest

from lab.tests.simulation.fleet.road import plan, running, segments, write_line
from slipstream.messages import (
    DriverReport,
    Message,
    PlanAcknowledgement,
    PlannedCrossing,
    PlatoonControl,
    PlatoonManagement,
    RequestStatus,
    SignalPhaseAndTiming,
    SignalRequest,
    SignalStatus,
    VehiclePosition,
    VehicleProgress,
    VehicleSensing,
)
from slipstream_lab.simulation.fleet.exchange import Exchange
from slipstream_lab.simulation.fleet.sensing import standing
from tests.vehicle_agent.road import spat
from vehicle_agent.agent import Agent, AgentParameters

INTERSECTIONS = ("north", "south")


class Signals:
    """A controller that tells red everywhere and records what is asked."""

    def __init__(self) -> None:
        self.asked: list[SignalRequest] = []
        self.told: list[str] = []
        self.answers: list[SignalStatus] = []

    def spat(self, intersection: str, now_s: float) -> SignalPhaseAndTiming:
        """The same for all time."""
        self.told.append(intersection)
        return spat(0.0, ("stop-And-Remain", 0.0, 1e6, 1e6), intersection=intersection)

    def receive(self, request: SignalRequest, now_s: float) -> None:
        """A request."""
        self.asked.append(request)

    def step(self, now_s: float) -> list[SignalStatus]:
        """Answers."""
        given, self.answers = self.answers, []
        return given


class Town:
    """An exchange of three vehicles whose clock is set by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, **world: float) -> None:
        self.now_s = 0.0
        self.signals = Signals()
        self.sent: list[Message] = []
        self.received: list[tuple[str, Message]] = []
        self.exchange = Exchange(
            dict.fromkeys(("one", "two", "three"), AgentParameters(interval_s=0.5)),
            self.signals,  # type: ignore[arg-type]
            INTERSECTIONS,
            lambda: self.now_s,
            self.sent.append,
            10.0,
            **world,  # type: ignore[arg-type]
        )
        take = Agent.receive
        town = self

        def receive(agent: Agent, message: Message, now_ns: int) -> None:
            town.received.append((agent.vehicle, message))
            take(agent, message, now_ns)

        monkeypatch.setattr(Agent, "receive", receive)

    def drives(self, vehicle: str, segment: str, front_m: float = 100.0) -> None:
        """A vehicle senses, on the road."""
        self.exchange.advise(
            VehicleSensing(
                vehicle=vehicle,
                time_ns=round(self.now_s * 1e9),
                on_road=True,
                segment=segment,
                crossing=False,
                lane=0,
                front_m=front_m,
                speed_mps=20.0,
                acceleration_mps2=0.0,
                driven_m=0.0,
                ahead=None,
                behind=None,
            )
        )

    def heard(self, kind: type[Message]) -> dict[str, list[str]]:
        """Which vehicles heard messages of a kind, from whom."""
        found: dict[str, list[str]] = {}
        for vehicle, message in self.received:
            if isinstance(message, kind):
                found.setdefault(vehicle, []).append(message.vehicle)  # type: ignore[attr-defined]
        return found


@pytest.fixture
def town(monkeypatch: pytest.MonkeyPatch) -> Town:
    """Three vehicles."""
    return Town(monkeypatch)


def test_platoon_messages_reach_those_who_listen_within_the_step(town: Town) -> None:
    """Two on one road hear each other, the one elsewhere nobody, and nobody itself."""
    for vehicle, path in (("one", "ab"), ("two", "ab"), ("three", "c")):
        town.exchange.send_plan(plan(segments(path), vehicle=vehicle))
    for _ in range(2):
        town.now_s += 0.5
        town.drives("one", "a", 200.0)
        town.drives("two", "a", 100.0)
        town.drives("three", "c")
    assert town.heard(PlatoonControl) == {"one": ["two", "two"], "two": ["one"]}
    assert not any(isinstance(m, PlatoonControl | PlatoonManagement) for m in town.sent)


def test_copies_are_lost_each_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of what vehicles send each other; what is for the dispatcher is not."""
    town = Town(monkeypatch, loss=0.5)
    for vehicle in ("one", "two", "three"):
        town.exchange.send_plan(plan(segments("ab"), vehicle=vehicle))
        town.drives(vehicle, "a", 100.0)
    for step in range(100):
        town.now_s += 0.1
        town.drives("one", "a", 100.0 + step)
    heard = town.heard(PlatoonControl)
    assert all(30 < heard[name].count("one") < 70 for name in ("two", "three"))
    assert heard["two"] != heard["three"]
    assert sum(isinstance(message, PlanAcknowledgement) for message in town.sent) == 3


def test_a_late_message_comes_with_the_first_step_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.12 s take two steps of 0.1 s."""
    town = Town(monkeypatch, latency_s=0.12)
    for vehicle in ("one", "two"):
        town.exchange.send_plan(plan(segments("ab"), vehicle=vehicle))
    town.drives("two", "a", 100.0)
    town.drives("one", "a", 200.0)
    heard = []
    for _ in range(3):
        heard.append(len(town.heard(PlatoonControl).get("two", [])))
        town.now_s += 0.1
        town.exchange.begin_step()
    assert heard == [0, 0, 1]


def test_the_dispatcher_gets_what_is_for_it(town: Town) -> None:
    """Acknowledgements, positions and progress, at once."""
    town.now_s = 100.0
    town.exchange.send_plan(plan(segments("a"), vehicle="one"))
    assert [type(message) for message in town.sent] == [PlanAcknowledgement]
    town.exchange.advise(standing("one", "a", town.exchange.now_ns))
    assert {type(m) for m in town.sent[1:]} == {VehiclePosition, VehicleProgress}
    sent = len(town.sent)
    town.exchange.report(
        DriverReport(vehicle="one", time_ns=0, event="refused", stop=None, reason="flat tyre")
    )
    answers = [m for m in town.sent[sent:] if isinstance(m, PlanAcknowledgement)]
    assert [(answer.accepted, answer.reason) for answer in answers] == [(False, "flat tyre")]


def test_signals_tell_whoever_listens_and_nobody_else(town: Town) -> None:
    """The signal on the path is read when its vehicle is near, the other one never."""
    crossing = PlannedCrossing(
        length_m=20.0, speed_mps=13.0, yields=False, intersection="north", signal_groups=((0, 3),)
    )
    first, second = segments("ab")
    led = plan([first.model_copy(update={"crossing": crossing}), second], vehicle="one")
    town.exchange.send_plan(led)
    town.exchange.advise(standing("two", "a", 0))
    assert town.signals.told == []
    town.drives("one", "a", 2800.0)
    town.drives("one", "a", 2810.0)
    assert set(town.signals.told) == {"north"}


def test_signals_answer_whom_they_answer(town: Town) -> None:
    """Status messages go to the vehicles that are named in them."""
    status = RequestStatus(vehicle="two", request=1, status="granted")
    town.signals.answers = [
        SignalStatus(intersection="north", sequence=1, time_ns=0, requests=(status,))
    ]
    town.exchange.begin_step()
    assert [vehicle for vehicle, _ in town.received] == ["two"]


def test_plans_are_kept_for_navigation(town: Town) -> None:
    """The newest four of each vehicle; of others none. A vehicle is due until it asks."""
    for cycle in range(1, 7):
        town.exchange.send_plan(plan(segments("a"), vehicle="one", cycle=cycle))
    town.exchange.send_plan(plan(segments("a"), vehicle="stranger"))
    known = [cycle for cycle in range(9) if town.exchange.plan("one", cycle) is not None]
    assert known == [3, 4, 5, 6]
    assert town.exchange.plan("two", 3) is None
    assert (town.exchange.is_due("one"), town.exchange.is_due("two")) == (True, False)
    town.exchange.advise(standing("one", "a", 0))
    assert not town.exchange.is_due("one")


@pytest.mark.slow
def test_nobody_needs_a_bus(tmp_path: Path) -> None:
    """A tour's messages to the dispatcher are those of a vehicle on the bus."""
    with running(write_line(tmp_path)) as found:
        found.exchange.send_plan(plan([*segments("c", 0), *segments("b", 1)], "one"))
        found.until(lambda: "one" in found.world.begun_s)
        kinds = {type(message) for message in found.sent}
    assert kinds == {PlanAcknowledgement, VehiclePosition, VehicleProgress}
