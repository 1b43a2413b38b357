"""Prometheus metrics of the dashboard."""

from __future__ import annotations

from prometheus_client import Counter, Gauge

MESSAGES = Counter("slipstream_dashboard_messages_total", "Messages taken from the bus.", ["kind"])
BAD_MESSAGES = Counter(
    "slipstream_dashboard_bad_messages_total",
    "Messages that were not what their key says.",
    ["kind"],
)
REQUESTS = Counter(
    "slipstream_dashboard_requests_total", "Answers of the operator's page, by status.", ["status"]
)
FAILURES = Counter(
    "slipstream_dashboard_server_failures_total", "Times that the page's server went down."
)
VIEWERS = Gauge("slipstream_dashboard_viewers", "Browsers that follow the operator's page.")
DROPPED = Counter(
    "slipstream_dashboard_viewers_dropped_total", "Browsers cut off as they read too slowly."
)
DELTA_BYTES = Counter(
    "slipstream_dashboard_delta_bytes_total", "Compressed changes made for browsers, once for all."
)
CLIENTS = Gauge("slipstream_dashboard_clients", "Browsers connected to the 3D view.")
UPDATES = Counter("slipstream_dashboard_updates_total", "Views built and shown in the 3D view.")
RESIDENT_MB = Gauge("slipstream_dashboard_resident_megabytes", "Resident memory of the process.")
