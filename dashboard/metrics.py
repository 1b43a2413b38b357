"""Prometheus metrics of the dashboard."""

from __future__ import annotations

from prometheus_client import Counter, Gauge

MESSAGES = Counter("slipstream_dashboard_messages_total", "Messages taken from the bus.", ["kind"])
BAD_MESSAGES = Counter(
    "slipstream_dashboard_bad_messages_total",
    "Messages that were not what their key says.",
    ["kind"],
)
CLIENTS = Gauge("slipstream_dashboard_clients", "Browsers connected.")
UPDATES = Counter("slipstream_dashboard_updates_total", "Views built and shown.")
RESIDENT_MB = Gauge("slipstream_dashboard_resident_megabytes", "Resident memory of the process.")
