"""Several agents in one process: each message to those that it is for; signals are shared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from slipstream import freshness
from slipstream.messages import (
    DriverReport,
    Message,
    PlatoonControl,
    PlatoonManagement,
    SegmentState,
    SignalPhaseAndTiming,
    SignalStatus,
    VehicleAdvice,
    VehiclePlan,
    VehicleSensing,
    platoon_controls_on,
)
from vehicle_agent.agent import Agent, AgentParameters
from vehicle_agent.reports import Outgoing
from vehicle_agent.roadside import Roadside
from vehicle_agent.signals import SignalTimings


class AgentHost:
    """The agents of some vehicles, given by id, which share states and signals."""

    def __init__(
        self,
        vehicles: Mapping[str, AgentParameters],
        stale_after_s: float = freshness.STALE_AFTER_S,
    ) -> None:
        self._timings, self._roadside = SignalTimings(), Roadside(stale_after_s)
        self.agents = {
            name: Agent(name, own, self._timings, self._roadside) for name, own in vehicles.items()
        }
        self._topics: dict[str, frozenset[str]] = dict.fromkeys(vehicles, frozenset())
        self._listeners: dict[str, dict[str, None]] = {}

    def topics(self) -> frozenset[str]:
        """Key expressions that some agent listens to."""
        return frozenset(self._listeners)

    def receive(self, message: Message, now_ns: int) -> None:
        """Give a message of any kind but a VehicleSensing to the agents that it is for."""
        for name in self._addressees(message, now_ns):
            agent = self.agents.get(name)
            if agent is not None:
                agent.receive(message, now_ns)
                self._follow(name, agent)

    def advise(self, sensing: VehicleSensing, now_ns: int) -> tuple[VehicleAdvice, list[Outgoing]]:
        """One vehicle's advice by its latest sensing, and what its agent has to send."""
        agent = self.agents[sensing.vehicle]
        advice = agent.advise(sensing, now_ns)
        self._follow(sensing.vehicle, agent)
        return advice, agent.take_outgoing()

    def _addressees(self, message: Message, now_ns: int) -> Iterable[str]:
        match message:
            case PlatoonControl():
                listening = self._listeners.get(platoon_controls_on(message.path[0]), {})
                return [name for name in listening if name != message.vehicle]
            case PlatoonManagement():
                return [message.partner]
            case VehiclePlan() | DriverReport():
                return [message.vehicle]
            case SignalStatus():
                return dict.fromkeys(request.vehicle for request in message.requests)
            # One that is dated ahead would keep out those that come once its clock is set.
            case SegmentState() if not freshness.is_ahead(message.time_ns, now_ns):
                self._roadside.receive(message)
            case SignalPhaseAndTiming() if not freshness.is_ahead(message.time_ns, now_ns):
                self._timings.receive(message)
        return ()

    def _follow(self, name: str, agent: Agent) -> None:
        """Take over what an agent listens to now."""
        wanted, before = agent.topics(), self._topics[name]
        if wanted is before:
            return
        self._topics[name] = wanted
        for key in before - wanted:
            self._listeners[key].pop(name, None)
            if not self._listeners[key]:
                del self._listeners[key]
        for key in wanted - before:
            self._listeners.setdefault(key, {})[name] = None
