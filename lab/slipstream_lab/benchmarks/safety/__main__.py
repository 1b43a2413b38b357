"""`python -m slipstream_lab.benchmarks.safety`: exit status 0 if no vehicle touches another one."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Final

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine
from slipstream_lab.benchmarks.aims import Check, Load, check_table, machine
from slipstream_lab.benchmarks.command import Measured, report, start
from slipstream_lab.benchmarks.safety.campaign import Tally, run, worst_of
from slipstream_lab.benchmarks.safety.rogue import ATTACKS, HONEST, Harm, harm_of

_SHARES: Final[Mapping[str, float]] = {"none": 0.4, "agent": 0.2, "router": 0.2, "sensor": 0.2}
"""Of the stops, by what fails."""
_CALM_SHARE: Final = 0.03
_MOST_CALM: Final = 300
"""Drives in which nobody brakes take twelve times as long as a stop."""

_GENERATIONS: Final = 20
_OFFSPRING: Final = 24
_SEARCHED: Final = 10_000
_FEWEST: Final = 50
_NEARER_M: Final = 0.1
_ROGUE_S: Final = 600.0
"""Of each attack: what it costs most within an hour, it costs in these."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.safety",
        description="Emergency stops of platoons, drawn over the declared envelope.",
    )
    parser.add_argument(
        "--stops", type=int, default=40_000, help="besides drives in calm traffic (default 40000)"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--out", type=Path, default=Path(".slipstream") / "safety")
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)

    def measure() -> Measured:
        if options.stops < _FEWEST:
            raise InputError("--stops", f"{options.stops} are too few", f"give {_FEWEST} or more")
        load, done = Load(), 0
        counts = {kind: round(share * options.stops) for kind, share in _SHARES.items()}
        counts["calm"] = min(_MOST_CALM, round(_CALM_SHARE * options.stops))
        search = options.stops >= _SEARCHED
        with (
            ProgressLine("stopping", sys.stderr) as line,
            ProcessPoolExecutor(options.workers) as executor,
        ):

            def progress(stops: int) -> None:
                nonlocal done
                done += stops
                line.update(done, sum(counts.values()))

            tallies = {kind: run(kind, count, executor, progress) for kind, count in counts.items()}
            found = {
                kind: worst_of(tallies[kind].worst, _GENERATIONS, _OFFSPRING, executor)
                for kind in _SHARES
                if search
            }
            attacks = [*ATTACKS] if search else []
            rogues = dict(
                zip(
                    attacks,
                    executor.map(harm_of, attacks, [_ROGUE_S] * len(attacks)),
                    strict=True,
                )
            )
        checks = _checks(tallies, {kind: least for kind, (least, _) in found.items()})
        checks += _rogue_checks(rogues)
        figures = {
            "machine": machine(),
            **load.figures(),
            "kinds": {kind: _figures(tally) for kind, tally in tallies.items()},
            "search": {k: {"least_m": m, "case": asdict(case)} for k, (m, case) in found.items()},
        }
        figures["rogue"] = {name: asdict(one) for name, one in rogues.items()}
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "report.json").write_text(json.dumps(figures, indent=1), encoding="utf-8")
        lines = ["# Emergency stops of platoons", "", *check_table(checks), "", *_table(tallies)]
        lines += _rogue_table(rogues)
        (options.out / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return Measured(options.out, checks)

    return report("safety", measure, as_json=options.json)


def _checks(tallies: Mapping[str, Tally], searched: Mapping[str, float]) -> list[Check]:
    checks = []
    for kind, tally in tallies.items():
        name = {"none": "no fault", "calm": "nobody brakes"}.get(kind, f"{kind} fails")
        touched = len(tally.collisions) + len(tally.traffic)
        checks.append(Check(f"collisions, {name}", f"{touched} of {tally.stops}", "0", not touched))
    calm = -tallies["calm"].hardest_mps2
    checks.append(Check("hardest, nobody brakes", f"{calm:.2f} m/s²", "≤ 2.5", calm <= 2.5))
    for kind, least_m in searched.items():
        checks.append(Check(f"least gap searched, {kind}", f"{least_m:.2f} m", "> 0", least_m > 0))
    return checks


def _rogue_checks(rogues: Mapping[str, Harm]) -> list[Check]:
    if not rogues:
        return []
    told = [one for name, one in rogues.items() if ATTACKS[name].told_only]
    slowest = max(one.slowdown_s for one in rogues.values())
    nearest = min(one.above_law_m for one in told)
    # Noise takes vehicles below the law's gap that nobody misleads.
    honest = min(rogues[name].above_law_m for name in HONEST)
    nearer, by = nearest >= honest - _NEARER_M, f"≥ {honest:.2f} (honest) − {_NEARER_M:g} m"
    return [
        Check("slowdown by a rogue", f"{slowest:.1f} s", "≤ 60 s", slowest <= 60),
        Check("gap beyond the law, by telling", f"{nearest:.2f} m", by, nearer),
    ]


def _rogue_table(rogues: Mapping[str, Harm]) -> list[str]:
    rows = [
        f"- {name}: {one.slowdown_s:.1f} s in {_ROGUE_S:g} s, least gap {one.least_m:.2f} m, "
        f"beyond the law {one.above_law_m:+.2f} m; {', '.join(one.reasons) or 'nobody left'}"
        for name, one in rogues.items()
    ]
    return ["", "## rogue", "", *rows] if rows else []


def _figures(tally: Tally) -> dict[str, object]:
    return {
        "stops": tally.stops,
        "followers": tally.followers,
        "members": tally.members,
        "mean_gap_m": tally.gap_sum_m / max(1, tally.members),
        "least_m": tally.least_m,
        "leader_broke_promise": tally.broken,
        "hardest_mps2": tally.hardest_mps2,
        "collisions": [{"impact_mps": m, **asdict(case)} for m, case in tally.collisions[:20]],
        "traffic": [asdict(case) for case in tally.traffic[:20]],
    }


def _table(tallies: Mapping[str, Tally]) -> list[str]:
    rows = [
        "| fails | stops | followed | mean gap, m | least gap, m | members touched (m/s) | leader "
        "touched traffic | leader broke its promise |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for kind, tally in tallies.items():
        hit = f"{len(tally.collisions)}"
        if tally.collisions:
            hit += f" ({tally.collisions[0][0]:.1f})"
        share = tally.followers / max(1, tally.members)
        rows.append(
            f"| {kind} | {tally.stops} | {share:.1%} | {tally.gap_sum_m / tally.members:.2f} | "
            f"{tally.least_m:.2f} | {hit} | {len(tally.traffic)} | {tally.broken} |"
        )
    return rows


if __name__ == "__main__":
    start(main)
