"""Prometheus metrics of the agents' process."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

ADVICE = Counter("slipstream_agent_advice", "Advice given, by mode", ["mode"])
ADVICE_SECONDS = Histogram(
    "slipstream_agent_advice_seconds",
    "Time to find one advice",
    buckets=(0.0001, 0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.05),
)
BAD_MESSAGES = Counter("slipstream_agent_bad_messages", "Messages that could not be read")
DISTRUSTED = Counter("slipstream_agent_distrusted", "Vehicles that an agent has ceased to believe")
DROPPED = Counter("slipstream_agent_dropped_messages", "Messages dropped as too many waited")
FAULTS = Counter("slipstream_agent_faults", "Agents that failed at a message or an advice")
ON_ROAD = Gauge("slipstream_agent_vehicles_on_road", "Vehicles that drive")
