"""Agents and RSUs over the bus: advice that holds, plans that are kept, gates; signals in UTC."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest

from lab.tests.simulation.fleet.road import ns, plan, segments, state
from slipstream.messages import (
    ALL_PLANS,
    ALL_STATES,
    DriverReport,
    Message,
    VehicleAdvice,
    advice_key,
    driver_key,
    plan_key,
    sensing_key,
    state_key,
)
from slipstream_lab.simulation.fleet.sensing import standing
from slipstream_lab.simulation.live.agents import BusAgents, BusGates
from slipstream_lab.simulation.live.signals import in_utc
from tests.vehicle_agent.road import spat

S = 1_000_000_000


@dataclass
class Clock:
    """A clock that stands until it is moved."""

    now_ns: int = 1_795_000_000 * S

    def __call__(self) -> int:
        return self.now_ns


def advice(vehicle: str, now_ns: int) -> VehicleAdvice:
    """Advice that holds for half a second."""
    return VehicleAdvice(
        vehicle=vehicle,
        time_ns=now_ns,
        valid_until_ns=now_ns + S // 2,
        cycle=1,
        leg=0,
        mode="cruise",
        speed_mps=10.0,
        gap_m=None,
        lane=None,
        partner=None,
        depart_ns=None,
        green_at=None,
        text="",
        reason=None,
    )


@dataclass
class Wire:
    """A bus in this process: what is put, and who listens."""

    put: list[tuple[str, Message]] = field(default_factory=list)
    handlers: dict[str, Callable[[str, bytes], None]] = field(default_factory=dict)
    listened: set[str] = field(default_factory=set)

    def publisher(self, key: str, *, history: int) -> Any:
        """An outlet that records."""
        wire = self

        class Outlet:
            def put(self, message: Message) -> None:
                wire.put.append((key, message))

        return Outlet()

    def subscribe(
        self, key: str, handler: Callable[[str, bytes], None], *, history: bool = True
    ) -> None:
        """A subscription."""
        self.handlers[key] = handler

    def listener(self, name: str, handler: Callable[[str, bytes], None]) -> Any:
        """A listener whose keys are recorded."""
        self.handlers[name] = handler
        wire = self

        class Listener:
            def listen(self, keys: Collection[str]) -> None:
                wire.listened = set(keys)

        return Listener()


@pytest.fixture
def wire() -> Wire:
    """The bus."""
    return Wire()


@pytest.fixture
def clock() -> Clock:
    """The wall clock."""
    return Clock()


@pytest.fixture
def agents(wire: Wire, clock: Clock) -> BusAgents:
    """Of two vehicles."""
    return BusAgents(wire, ("van", "other"), clock)  # type: ignore[arg-type]


def test_advice_holds_until_its_end(wire: Wire, clock: Clock, agents: BusAgents) -> None:
    """Of each own vehicle the last; none once it is stale; noise changes nothing."""
    sensed = standing("van", "a", clock())
    assert wire.listened == {advice_key("van"), advice_key("other")}
    assert agents.advise(sensed) is None
    assert wire.put == [(sensing_key("van"), sensed)]
    told = advice("van", clock())
    wire.handlers["advice"](advice_key("van"), told.to_bytes())
    wire.handlers["advice"](advice_key("van"), b"noise")
    assert agents.advise(sensed) == told
    assert agents.advise(standing("other", "a", clock())) is None
    clock.now_ns += S // 2
    assert agents.advise(sensed) == told
    clock.now_ns += 1
    assert agents.advise(sensed) is None
    fresh = advice("van", clock())
    wire.handlers["advice"](advice_key("van"), fresh.to_bytes())
    assert agents.advise(sensed) == fresh


def test_the_newest_plans_are_kept_for_navigation(wire: Wire, agents: BusAgents) -> None:
    """Four of each own vehicle; a vehicle is due from a plan on until it asks."""
    assert not agents.is_due("van")
    for cycle in (3, 1, 2, 5, 4):
        told = plan(segments("a"), cycle=cycle)
        wire.handlers[ALL_PLANS](plan_key("van"), told.to_bytes())
    strange = plan(segments("a"), vehicle="strange")
    wire.handlers[ALL_PLANS](plan_key("strange"), strange.to_bytes())
    wire.handlers[ALL_PLANS](plan_key("van"), b"noise")
    assert agents.is_due("van")
    assert not agents.is_due("other")
    known = [cycle for cycle in range(7) if agents.plan("van", cycle) is not None]
    assert known == [2, 3, 4, 5]
    assert agents.plan("van", 5) == plan(segments("a"), cycle=5)
    agents.advise(standing("van", "a", 1))
    assert not agents.is_due("van")


def test_a_driver_says_it_to_the_own_agent(wire: Wire, clock: Clock, agents: BusAgents) -> None:
    """A report goes out under the vehicle's key."""
    said = DriverReport(vehicle="van", time_ns=clock(), event="served", stop="one", reason=None)
    agents.report(said)
    assert wire.put == [(driver_key("van"), said)]


@pytest.mark.parametrize(
    ("y_e", "age_s", "is_open", "is_turbulent"),
    [(1, 1, True, False), (0, 1, False, True), (None, 1, False, False), (1, 9, False, False)],
)
def test_gates_are_what_fresh_states_say(
    wire: Wire, clock: Clock, y_e: int | None, age_s: int, is_open: bool, is_turbulent: bool
) -> None:
    """Open on stable, turbulent on turbulent, neither where nothing fresh is known."""
    gates = BusGates(wire, clock)  # type: ignore[arg-type]
    told = msgspec.structs.replace(
        state("ab", clock() / 1e9, y_e), time_ns=clock() - age_s * S, window_s=10.0
    )
    wire.handlers[ALL_STATES](state_key("rsu-01", "ab"), b"noise")
    wire.handlers[ALL_STATES](state_key("rsu-01", "ab"), told.to_bytes())
    assert (gates.is_open("ab"), gates.is_turbulent("ab")) == (is_open, is_turbulent)
    assert not gates.is_open("ba")


def test_a_gate_closes_when_its_state_grows_stale(wire: Wire, clock: Clock) -> None:
    """Nothing need come for that."""
    gates = BusGates(wire, clock)  # type: ignore[arg-type]
    wire.handlers[ALL_STATES](
        state_key("rsu-01", "ab"),
        msgspec.structs.replace(state("ab", 0.0, 1), time_ns=clock()).to_bytes(),
    )
    assert gates.is_open("ab")
    clock.now_ns += 60 * S
    assert not gates.is_open("ab")


def test_signal_times_are_moved_to_utc() -> None:
    """All of a SPAT's times by the same, an open end stays open, nothing is before 1970."""
    told = spat(
        100.0, ("stop-And-Remain", 90.0, 110.0, 110.0), ("pre-Movement", 110.0, 112.0, None)
    )
    moved = in_utc(told, 1000 * S)
    assert moved.time_ns == ns(1100.0)
    (movement,) = moved.movements
    assert [(e.start_ns, e.min_end_ns, e.max_end_ns) for e in movement.events] == [
        (ns(1090.0), ns(1110.0), ns(1110.0)),
        (ns(1110.0), ns(1112.0), None),
    ]
    assert [event.state for event in movement.events] == ["stop-And-Remain", "pre-Movement"]
    assert in_utc(moved, -1000 * S) == told
    assert in_utc(told, -95 * S).movements[0].events[0].start_ns == 0


def test_the_plan_that_a_vehicle_follows_is_kept_however_many_it_refuses(
    wire: Wire, clock: Clock
) -> None:
    """Else a vehicle that stands at a stop would not know its way any more."""
    agents = BusAgents(wire, ["van"], clock)  # type: ignore[arg-type]
    for cycle in range(1, 11):
        sent = plan(segments("ab", 0), cycle=cycle)
        wire.handlers[ALL_PLANS](plan_key("van"), sent.to_bytes())
        followed = agents.plan("van", 1)
        assert followed is not None
        assert followed.cycle == 1
    assert agents.plan("van", 2) is None
    assert agents.plan("van", 10) is not None
