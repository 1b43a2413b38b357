"""Prometheus metrics of the dispatcher."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from prometheus_client import REGISTRY, Counter, Gauge, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from dispatcher_daemon.traffic import Reception
from slipstream.messages import CycleReport

STATES = Counter(
    "slipstream_dispatcher_states", "Segment states received, by verdict.", ["verdict"]
)
COUNTS = Counter(
    "slipstream_dispatcher_counts", "Quarter hours of counted vehicles received.", ["verdict"]
)
STATE_AGE = Histogram(
    "slipstream_dispatcher_state_age_seconds",
    "From a state's time to its place among the latest states.",
    buckets=(0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5),
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
ORDERS_TAKEN = Counter("slipstream_dispatcher_orders_taken", "New orders of callers.")
ORDERS_REFUSED = Counter(
    "slipstream_dispatcher_orders_refused", "Orders of callers that were refused.", ["kind"]
)
ORDER_SECONDS = Histogram(
    "slipstream_dispatcher_order_seconds",
    "From a caller's order, or change of one, to its being stored.",
    buckets=(0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5),
)
INSERTION_SECONDS = Histogram(
    "slipstream_dispatcher_insertion_seconds",
    "Wall time of putting new orders into plans between cycles, until they are out.",
    buckets=(0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10),
)
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
STANDBY = Gauge("slipstream_dispatcher_standby", "1 while it waits for another dispatcher's end.")
ALARMS = Gauge("slipstream_alarms", "Alarms in force.", ["severity"])
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
API_REQUESTS = Counter(
    "slipstream_dispatcher_api_requests", "Answers of the HTTP API, by status.", ["status"]
)
API_FAILURES = Counter(
    "slipstream_dispatcher_api_failures", "Times that the HTTP API went down and was started anew."
)
API_STREAMS = Gauge("slipstream_dispatcher_api_streams", "Event streams that are open.")
API_STREAMS_DROPPED = Counter(
    "slipstream_dispatcher_api_streams_dropped", "Event streams of clients that read too slowly."
)


class ReceptionCollector(Collector):
    """Each RSU's reception, computed when it is asked for.

    Attributes:
        figures: (RSU, its reception) of all.
        own: (times that the dispatcher itself stood still, states missed because of that).
    """

    def __init__(self) -> None:
        self.figures: Callable[[], Iterable[tuple[str, Reception]]] = tuple
        self.own: Callable[[], tuple[int, int]] = lambda: (0, 0)

    def collect(self) -> Iterator[Metric]:
        """The metrics, labelled by RSU."""
        states = CounterMetricFamily(
            "slipstream_dispatcher_rsu_states",
            "Segment states of an RSU: received, duplicate, out of order.",
            labels=["rsu", "kind"],
        )
        missed, delay, spread = (
            GaugeMetricFamily(f"slipstream_dispatcher_rsu_{name}", text, labels=["rsu"])
            for name, text in (
                ("missed", "Sequence numbers of an RSU that have not come."),
                ("delay_seconds", "Median of arrival less the state's time, latest states."),
                ("delay_spread_seconds", "Interquartile range of the same."),
            )
        )
        for rsu, found in self.figures():
            states.add_metric([rsu, "received"], found.received)
            states.add_metric([rsu, "duplicate"], found.duplicates)
            states.add_metric([rsu, "out_of_order"], found.out_of_order)
            missed.add_metric([rsu], found.missed)
            if found.delay_s is not None and found.delay_spread_s is not None:
                delay.add_metric([rsu], found.delay_s)
                spread.add_metric([rsu], found.delay_spread_s)
        stops, missed_here = self.own()
        yield from (states, missed, delay, spread)
        yield CounterMetricFamily(
            "slipstream_dispatcher_stops",
            "Times that the dispatcher itself stood still for seconds.",
            value=stops,
        )
        yield GaugeMetricFamily(
            "slipstream_dispatcher_states_missed_here",
            "States missed because of that, which no RSU is blamed for.",
            value=missed_here,
        )


RECEPTION = ReceptionCollector()
REGISTRY.register(RECEPTION)
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


def count_cycle(report: CycleReport) -> None:
    """Count a stored cycle."""
    CYCLES.labels(report.status).inc()
    CYCLE_SECONDS.observe(report.wall_s)
    PLANS.inc(report.plans)
    LAST_CYCLE.set(report.started_ns * 1e-9)
    for solver in report.solvers:
        SOLVER_RUNS.labels(solver.solver, solver.status).inc()
        SOLVER_SECONDS.labels(solver.solver).observe(solver.wall_s)
    if report.energy is not None:
        SAVED_KWH.labels("distance").set(report.energy.saved_distance_kwh)
        SAVED_KWH.labels("drag").set(report.energy.saved_drag_kwh)
        SAVED_KWH.labels("acceleration").set(report.energy.saved_acceleration_kwh)
