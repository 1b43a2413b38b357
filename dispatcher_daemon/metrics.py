"""Prometheus metrics of the dispatcher."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

STATES = Counter(
    "slipstream_dispatcher_states", "Segment states received, by verdict.", ["verdict"]
)
BAD_MESSAGES = Counter(
    "slipstream_dispatcher_bad_messages", "Messages that were not what their key promises."
)
CYCLES = Counter("slipstream_dispatcher_cycles", "Dispatch cycles, by how they ended.", ["status"])
CYCLE_FAULTS = Counter(
    "slipstream_dispatcher_schedule_faults",
    "Cycles overlapped, missed or raised; clock steps.",
    ["kind"],
)
CYCLE_SECONDS = Histogram(
    "slipstream_dispatcher_cycle_seconds",
    "Wall time of a cycle, from snapshot to verified plans.",
    buckets=(0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 30, 60),
)
SOLVER_RUNS = Counter(
    "slipstream_dispatcher_solver_runs", "Solver runs, by how they ended.", ["solver", "status"]
)
SOLVER_SECONDS = Histogram(
    "slipstream_dispatcher_solver_seconds",
    "Wall time of a solver in a cycle.",
    ["solver"],
    buckets=(0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 30),
)
PLANS = Counter("slipstream_dispatcher_plans", "Vehicle plans published.")
GATES_OPEN = Gauge("slipstream_dispatcher_gates_open", "Segments open for platooning.")
SAVED_KWH = Gauge(
    "slipstream_dispatcher_saved_kwh",
    "Energy saved against the baseline in the last cycle.",
    ["part"],
)
LAST_CYCLE = Gauge(
    "slipstream_dispatcher_last_cycle_timestamp_seconds", "UTC of the last stored cycle's start."
)
CLOCK_UNTRUSTED = Gauge(
    "slipstream_dispatcher_clock_untrusted",
    "1 while no cycle is deleted by age: the clock is far ahead of the cycles stored.",
)
QUANTUM_JOBS = Gauge(
    "slipstream_dispatcher_quantum_jobs",
    "Jobs of the quantum device that are open or ended within a day, by state.",
    ["state"],
)
QUANTUM_USED_SECONDS = Gauge(
    "slipstream_dispatcher_quantum_used_seconds",
    "Device time charged or reserved in the last 24 hours.",
)
QUANTUM_BREAKER = Gauge(
    "slipstream_dispatcher_quantum_breaker", "1 for the state of the device's breaker.", ["state"]
)
QUANTUM_FAULTS = Counter(
    "slipstream_dispatcher_quantum_faults", "Faults of the quantum device's service.", ["kind"]
)
CLUSTER_PROCESSES = Gauge(
    "slipstream_dispatcher_cluster_processes", "Processes of the cluster's workers that are ready."
)
CLUSTER_CALLS = Counter(
    "slipstream_dispatcher_cluster_calls",
    "Calls sent to the cluster, by how they ended; lost ones were made up for on this machine.",
    ["result"],
)
CLUSTER_BYTES = Counter("slipstream_dispatcher_cluster_bytes", "Bytes sent to the cluster.")
CLUSTER_OUTAGES = Counter(
    "slipstream_dispatcher_cluster_outages", "Times that the cluster stopped answering."
)
