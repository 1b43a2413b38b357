"""What an agent keeps of segments' states, and of sensing and states of a clock that was ahead."""

from __future__ import annotations

import pytest

from slipstream.freshness import STALE_AFTER_S
from tests.vehicle_agent.road import ns, state
from tests.vehicle_agent.tours import VAN, sensing
from vehicle_agent.agent import Agent, AgentParameters
from vehicle_agent.daemon import is_news
from vehicle_agent.host import AgentHost
from vehicle_agent.roadside import Roadside


def test_states_of_roads_left_behind_are_forgotten() -> None:
    """A van that drives for months keeps none but those that may still count."""
    roadside = Roadside()
    for number in range(1000):
        roadside.receive(state(f"s{number}", float(number)))
        roadside.at(ns(float(number)))
    assert roadside.is_open("s999")
    assert not roadside.is_open("s990")
    assert len(roadside._states) <= 60 + STALE_AFTER_S + 1


@pytest.mark.parametrize("alone", [False, True])
def test_a_state_of_the_future_keeps_out_none_that_comes_after_it(alone: bool) -> None:
    """An RSU whose clock was an hour ahead until it was set."""
    roadside = Roadside()
    receiver: Agent | AgentHost
    if alone:
        receiver = Agent(VAN, roadside=roadside)
    else:
        receiver = AgentHost({VAN: AgentParameters()})
        roadside = receiver._roadside
    receiver.receive(state("a", 3600.0), ns(1))
    receiver.receive(state("a", 2.0), ns(2))
    roadside.at(ns(2))
    assert roadside.is_open("a")


def test_sensing_of_the_future_keeps_out_none_that_comes_after_it() -> None:
    """Of two in order the later counts; one from before the clock was set back does not."""
    early, late = sensing(1), sensing(2)
    assert is_news(early, None, ns(1))
    assert is_news(late, early, ns(2))
    assert not is_news(early, late, ns(2))
    assert is_news(late, sensing(3600), ns(2))
