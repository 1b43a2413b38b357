"""The ledger of faults: each beside what came of it, as CSV; misses first in Markdown."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from slipstream_lab.benchmarks.aims import Check, report_head, write_report
from slipstream_lab.benchmarks.chaos.run import ChaosResult, Outcome
from slipstream_lab.benchmarks.command import Measured

_COLUMNS = (
    *("number", "kind", "target", "value", "begin", "end", "recovery_s", "limit_s", "why"),
    *("lost", "was_stable", "shown", "ended", "stretch"),
)
_LOST = "acknowledged orders, cancellations and cycles that are not stored"


def write(folder: Path, result: ChaosResult, wanted: int, about: Mapping[str, object]) -> Measured:
    """Write report.md, report.json and ledger.csv into an existing folder."""
    checks = checks_of(result, wanted)
    missing = [f"{kind}: {why}" for kind, why in result.without.items()]
    text = markdown(result, checks, missing, about)
    write_report(folder, text, about, asdict(result))
    with (folder / "ledger.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(_COLUMNS)
        rows.writerows(_row(number, one) for number, one in enumerate(result.outcomes, 1))
    return Measured(folder, checks, missing)


def checks_of(result: ChaosResult, wanted: int) -> list[Check]:
    """The aims."""
    outcomes = result.outcomes
    number = len(outcomes)
    lost = len({*result.lost, *(one for outcome in outcomes for one in outcome.lost)})
    cameras = [one for one in outcomes if one.fault.kind == "camera"]
    checks = [
        Check("faults", f"{number}", f"{wanted}", number >= wanted),
        Check(f"{_LOST}, of {len(result.told)} and {result.cycles}", f"{lost}", "0", lost == 0),
    ]
    for what, limit_s in (("a fault", 5.0), ("a partition", 15.0)):
        some = [one for one in outcomes if one.fault.recovery_s == limit_s]
        late = [one for one in some if not one.in_time]
        told = f"{len(some) - len(late)} of {len(some)}, {_times(some)}"
        checks.append(Check(f"well within {limit_s:g} s of {what}", told, "all", not late))
    shown = sum(bool(one.shown) for one in cameras)
    stable = sum(bool(one.was_stable) for one in cameras)
    what = f"camera faults with a stable flag used or shown, of {len(cameras)} ({stable} stable)"
    ended = sum(len(one.ended) for one in outcomes)
    return [
        *checks,
        Check(what, f"{shown}", "0", shown == 0),
        Check("daemons that ended by themselves", f"{ended}", "0", ended == 0),
        Check("orders served again", f"{result.served_again}", "0", result.served_again == 0),
    ]


def markdown(
    result: ChaosResult,
    checks: Sequence[Check],
    missing: Sequence[str],
    about: Mapping[str, object],
) -> str:
    """The report as people read it."""
    lines = report_head("Chaos", about, checks, missing)
    missed = [(number, one) for number, one in enumerate(result.outcomes, 1) if _is_missed(one)]
    stretch = float(np.median([one.stretch for one in result.outcomes] or [1.0]))
    lines += ["", f"Other work on the machine stretched ours to {stretch:.1f} times (median)."]
    lines += ["", f"## What missed: {len(missed)} of {len(result.outcomes)}", ""]
    lines += [f"- {number}: {one.fault}: {_why(one)}" for number, one in missed] or ["Nothing."]
    lines += [f"- at the end: {one}" for one in result.lost]
    lines += ["", "## By kind", "", "| kind | faults | well after, s: median | largest | late |"]
    lines += ["|---|--:|--:|--:|--:|"]
    for kind in sorted({one.fault.kind for one in result.outcomes}):
        some = [one for one in result.outcomes if one.fault.kind == kind]
        after = [one.recovery_s for one in some if one.recovery_s is not None]
        figures = f"{np.median(after):.1f} | {max(after):.1f}" if after else "– | –"
        lines.append(f"| {kind} | {len(some)} | {figures} | {sum(not o.in_time for o in some)} |")
    answers = ", ".join(f"{number} × {s or 'none'}" for s, number in sorted(result.answers.items()))
    lines += ["", f"Answers to the caller of orders: {answers}.", "Each fault: ledger.csv.", ""]
    return "\n".join(lines)


def _is_missed(outcome: Outcome) -> bool:
    return not outcome.in_time or bool(outcome.lost or outcome.shown or outcome.ended)


def _why(outcome: Outcome) -> str:
    after = "not well" if outcome.recovery_s is None else f"well after {outcome.recovery_s:.1f} s"
    late = "" if outcome.in_time else f" (at the limit: {outcome.why})"
    shown = [f"shown as stable: {one}" for one in outcome.shown]
    return "; ".join((f"{after}{late}", *outcome.lost, *shown, *outcome.ended))


def _times(outcomes: Sequence[Outcome]) -> str:
    after = [one.recovery_s for one in outcomes if one.recovery_s is not None]
    return f"median {np.median(after):.1f} s, largest {max(after):.1f}" if after else "none"


def _row(number: int, outcome: Outcome) -> Sequence[object]:
    fault = outcome.fault
    return (
        number,
        fault.kind,
        " ".join(fault.targets),
        "" if fault.value is None else fault.value,
        _utc(outcome.begin_s),
        _utc(outcome.end_s),
        "" if outcome.recovery_s is None else f"{outcome.recovery_s:.2f}",
        f"{fault.recovery_s:g}",
        "" if outcome.in_time else outcome.why or "",
        "; ".join(outcome.lost),
        "" if outcome.was_stable is None else int(outcome.was_stable),
        "; ".join(outcome.shown),
        "; ".join(outcome.ended),
        f"{outcome.stretch:.1f}",
    )


def _utc(at_s: float) -> str:
    return datetime.fromtimestamp(at_s, UTC).isoformat(timespec="milliseconds")
