"""Agents on the bus: sensing in, advice out ten times a second, for the vehicles of a process."""

from __future__ import annotations

import gc
import logging
import threading
import time
from collections import deque
from functools import partial
from typing import Final

from slipstream import freshness
from slipstream.braking import HARDEST_MPS2
from slipstream.bus import Bus, Publisher
from slipstream.errors import InputError
from slipstream.messages import (
    Message,
    PlanAcknowledgement,
    VehicleProgress,
    VehicleSensing,
    advice_key,
    driver_key,
    plan_key,
    sensing_key,
)
from slipstream.service import LogLimiter, Service, configure_logging
from slipstream.service.memory import configure_allocator
from vehicle_agent import metrics
from vehicle_agent.agent import DEFAULT_LENGTH_M, AgentParameters
from vehicle_agent.host import AgentHost
from vehicle_agent.settings import AgentSettings
from vehicle_agent.tour_file import TourFile
from vehicle_agent.wire import message_of

log = logging.getLogger(__name__)

INTERVAL_S: Final = 0.1
_WAITING: Final = 20_000
"""Messages that may wait for the agents; beyond them the oldest, too old by then, are dropped."""
_LATE_NS: Final = round(1.5 * INTERVAL_S * 1e9)
_PATIENCE_NS: Final = 5_000_000_000


class AgentDaemon:
    """The agents of a process. The bus's threads deliver messages, the main thread advises."""

    def __init__(self, settings: AgentSettings, bus: Bus) -> None:
        parameters = {
            vehicle.id: AgentParameters(
                vehicle.type.profile.physics,
                vehicle.type.length_m or DEFAULT_LENGTH_M,
                vehicle.type.max_speed_mps,
                INTERVAL_S,
                settings.stale_after_s,
                vehicle.type.drafting,
                vehicle.type.brakes.on(settings.road),
                HARDEST_MPS2[settings.road],
            )
            for vehicle in settings.vehicles
        }
        self._host = AgentHost(parameters, settings.stale_after_s)
        self._files = {
            name: TourFile(settings.state, agent.tour) for name, agent in self._host.agents.items()
        }
        for file in self._files.values():
            file.load()
        self._bus = bus
        self._advice = {n: bus.publisher(advice_key(n), history=0) for n in parameters}
        self._publishers: dict[str, Publisher] = {}
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=_WAITING)
        self._arrived = threading.Event()
        self._sensing: dict[str, VehicleSensing] = {}
        self._advised_ns: dict[str, int] = {}
        self._limiter = LogLimiter()
        own = {key for n in parameters for key in (sensing_key(n), driver_key(n))}
        bus.listener("vehicle", self._on_message, every=True).listen(own)
        plans = bus.listener("plans", self._on_message)
        plans.listen({plan_key(name) for name in parameters}, history=True)
        self._around = bus.listener("around the vehicle", self._on_message, every=True)
        self._plan_keys = frozenset(plan_key(name) for name in parameters)

    def _on_message(self, key: str, payload: bytes) -> None:
        if len(self._waiting) == _WAITING:
            metrics.DROPPED.inc()
        self._waiting.append((key, payload))
        self._arrived.set()

    def step(self, timeout_s: float) -> None:
        """Take in what has arrived, or arrives within a time, then advise each vehicle that has
        sensed anew, or not for long.
        """
        self._arrived.wait(timeout_s)
        self._arrived.clear()
        sensed: dict[str, None] = {}
        while self._waiting:
            key, payload = self._waiting.popleft()
            name = self._take(key, payload)
            if name is not None:
                sensed[name] = None
        now_ns = time.time_ns()
        for name, sensing in self._sensing.items():
            silent_ns = now_ns - self._advised_ns.get(name, 0)
            old_ns = now_ns - sensing.time_ns
            if name in sensed or (silent_ns > _LATE_NS and old_ns < _PATIENCE_NS):
                self._advise(sensing, now_ns)
        self._around.listen(self._host.topics() - self._plan_keys)
        metrics.ON_ROAD.set(sum(sensing.on_road for sensing in self._sensing.values()))

    def _take(self, key: str, payload: bytes) -> str | None:
        """One message; the vehicle if it is its sensing."""
        try:
            message = message_of(key, payload)
        except InputError as error:
            metrics.BAD_MESSAGES.inc()
            self._limiter.warn(log, "bad message", str(error))
            return None
        if isinstance(message, VehicleSensing):
            before = self._sensing.get(message.vehicle)
            if message.vehicle in self._files and is_news(message, before, time.time_ns()):
                self._sensing[message.vehicle] = message
                return message.vehicle
            return None
        try:
            self._host.receive(message, time.time_ns())
        except Exception as error:
            self._fault(f"a message on {key}", error)
        return None

    def _advise(self, sensing: VehicleSensing, now_ns: int) -> None:
        """One vehicle's advice; its fault leaves the others alone."""
        name, began = sensing.vehicle, time.perf_counter()
        self._advised_ns[name] = now_ns
        try:
            advice, outgoing = self._host.advise(sensing, now_ns)
        except Exception as error:
            self._fault(f"the agent of {name}", error)
            return
        metrics.ADVICE_SECONDS.observe(time.perf_counter() - began)
        metrics.ADVICE.labels(advice.mode).inc()
        distrusts = self._host.agents[name].distrusts
        if distrusts is not None:
            metrics.DISTRUSTED.inc()
            log.warning("%s does not believe another vehicle for an hour: %s", name, distrusts)
        self._advice[name].put(advice)
        self._files[name].keep()
        for key, message in outgoing:
            self._publish(key, message)

    def _publish(self, key: str, message: Message) -> None:
        """Answers and progress are kept for a dispatcher that comes late; the rest is of now."""
        if not isinstance(message, PlanAcknowledgement | VehicleProgress):
            self._bus.put(key, message)
            return
        if key not in self._publishers:
            self._publishers[key] = self._bus.publisher(key)
        self._publishers[key].put(message)

    def _fault(self, what: str, error: Exception) -> None:
        metrics.FAULTS.inc()
        if self._limiter.allow(what):
            log.exception("%s failed: %s", what, error)


def is_news(message: VehicleSensing, before: VehicleSensing | None, now_ns: int) -> bool:
    """Whether sensing is no older than the one before, if that is not dated ahead of the clock."""
    if before is None or message.time_ns >= before.time_ns:
        return True
    return freshness.is_ahead(before.time_ns, now_ns)


def run_agents(settings: AgentSettings) -> None:
    """Run until SIGTERM or SIGINT."""
    configure_allocator()
    configure_logging("agent", settings.service)
    with Service("agent", settings.service) as service:
        bus = service.start("bus", partial(Bus.open, settings.bus), Bus.fault)
        daemon = AgentDaemon(settings, bus)
        # Loaded modules stay: to scan them in each collection would hold up advice.
        gc.collect()
        gc.freeze()
        service.ready()
        while not service.stopping.is_set():
            daemon.step(INTERVAL_S)
            service.progress(f"{len(settings.vehicles)} vehicles")
