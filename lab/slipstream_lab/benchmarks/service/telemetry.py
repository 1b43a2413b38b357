"""Segment states at a rate into the real dispatcher: what is lost, how late, for how much."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from slipstream.messages import ALL_STATES
from slipstream_lab.benchmarks.aims import Check, report_head, write_report
from slipstream_lab.benchmarks.service.grid import write_grid
from slipstream_lab.benchmarks.service.loaded import Cost, Loaded, run_load

MAX_LATENCY_S: Final = 0.1
FLEET: Final[dict[str, Any]] = {
    "depots": [{"id": "yard", "node": "0.0"}],
    "vehicles": [{"id": "van-a", "depot": "yard"}],
    "stops": [{"id": "shop", "node": "2.2"}],
}


@dataclass(frozen=True)
class TelemetryFigures:
    """What was measured. `p99_s`: upper bound of the 99th percentile, from publication to the
    traffic table, s; None: above the histogram's largest bound.
    """

    rsus: int
    rate: float
    seconds: float
    sent: int
    accepted: int
    outcomes: dict[str, int]
    missed: int
    cpu_share: float
    p99_s: float | None
    within: float
    late_s: float

    @property
    def lost(self) -> int:
        """States that did not get to the traffic table."""
        return self.sent - self.accepted

    @property
    def holds(self) -> bool:
        """Whether nothing was lost, in time, on one core."""
        return not self.lost and self.within >= 0.99 and self.cpu_share <= 1.0


def measure(
    rsus: int, segments_each: int, seconds: float, folder: Path, say: Callable[[str], None]
) -> TelemetryFigures:
    """Send each segment's state once a second for some time. Raises RuntimeError: a process ended,
    or the dispatcher did not start.
    """
    say(f"{rsus} RSUs with {segments_each} segments each, {seconds:.0f} s")
    watched, settings = watched_grid(folder, rsus, segments_each)
    found = run_load(
        folder, {**settings, "rsus": watched}, {"watched": watched, "seconds": seconds}, ALL_STATES
    )
    return _figures(rsus, found)


def watched_grid(
    folder: Path, rsus: int, segments_each: int
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Write a network that has as many segments, and a fleet of one van on it."""
    folder.mkdir(parents=True, exist_ok=True)
    number = rsus * segments_each
    size = 3
    while 4 * size * (size - 1) < number:
        size += 1
    names = write_grid(folder / "grid.net.xml", size)
    (folder / "fleet.json").write_text(json.dumps(FLEET))
    watched = {f"rsu-{n}": names[n * segments_each : (n + 1) * segments_each] for n in range(rsus)}
    return watched, {
        "network": str(folder / "grid.net.xml"),
        "fleet": str(folder / "fleet.json"),
    }


def _figures(rsus: int, found: Loaded) -> TelemetryFigures:
    age = "slipstream_dispatcher_state_age_seconds"
    earlier, after = found.before.buckets(age), found.after
    counts = {bound: count - earlier.get(bound, 0.0) for bound, count in after.buckets(age).items()}
    total = max(counts.values())
    p99 = next((b for b, count in sorted(counts.items()) if count >= 0.99 * total), None)
    accepted = after.total("slipstream_dispatcher_states_total", verdict="accepted")
    return TelemetryFigures(
        rsus=rsus,
        rate=found.sent / found.seconds,
        seconds=found.seconds,
        sent=found.sent,
        accepted=int(accepted),
        outcomes=after.outcomes(ALL_STATES),
        missed=int(after.total("slipstream_dispatcher_rsu_missed")),
        cpu_share=found.dispatcher_share,
        p99_s=None if p99 is None or p99 == float("inf") else p99,
        within=counts[MAX_LATENCY_S] / max(total, 1.0),
        late_s=found.late_s,
    )


def checks(found: TelemetryFigures) -> list[Check]:
    """The aims."""
    bound = "above 5 s" if found.p99_s is None else f"≤ {1e3 * found.p99_s:.0f} ms"
    return [
        Check(
            f"states lost of {found.sent}, {found.rate:.0f} a second from {found.rsus} RSUs",
            str(found.lost),
            "0",
            found.lost == 0,
        ),
        Check(
            "processor time of the dispatcher, of one core",
            f"{found.cpu_share:.2f}",
            "≤ 1",
            found.cpu_share <= 1.0,
        ),
        Check(
            "publication to traffic table, p99",
            bound,
            f"≤ {1e3 * MAX_LATENCY_S:.0f} ms",
            found.within >= 0.99,
        ),
    ]


def write(
    folder: Path,
    found: TelemetryFigures,
    steps: Sequence[TelemetryFigures],
    costs: Sequence[Cost],
    about: Mapping[str, str],
) -> list[Check]:
    """Write report.md and report.json; returns the aims."""
    aims = checks(found)
    lines = [
        *report_head("Segment states into one dispatcher", about, aims),
        "",
        "| states/s | lost | missed | superseded | core | p99, at most | within 100 ms "
        "| senders late |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|",
        *(
            f"| {step.rate:.0f} | {step.lost} | {step.missed} | "
            f"{step.outcomes['superseded']} | "
            f"{step.cpu_share:.2f} | "
            f"{'–' if step.p99_s is None else f'{1e3 * step.p99_s:.0f} ms'} | "
            f"{step.within:.2%} | {step.late_s:.2f} s |"
            for step in steps
        ),
        "",
        "| message | bytes | dispatcher, µs | router, µs | not handled |",
        "|---|--:|--:|--:|--:|",
        *(
            f"| {cost.what} | {cost.bytes:.0f} | {1e6 * cost.dispatcher_s:.0f} | "
            f"{1e6 * cost.router_s:.0f} | {cost.lost} |"
            for cost in costs
        ),
        "",
    ]
    content = {
        "steps": [asdict(step) for step in steps],
        "costs": [asdict(cost) for cost in costs],
    }
    write_report(folder, "\n".join(lines), about, content)
    return aims
