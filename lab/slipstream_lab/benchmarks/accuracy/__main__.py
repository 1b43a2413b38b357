"""`make bench-accuracy`: render the clips, follow each, print the accuracy of perception."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from edge_daemon.settings import TrackSettings
from slipstream_cli.progress import ProgressLine
from slipstream_lab.benchmarks.accuracy.clips import CLIPS, SECONDS, follow, make
from slipstream_lab.benchmarks.accuracy.report import (
    AccuracyRow,
    classes,
    count_misses,
    counts,
    features,
    misses,
    table,
)
from slipstream_lab.research.perception import (
    TrackComparison,
    compare,
    compare_counts,
    score,
    score_counts,
)
from slipstream_lab.simulation.scenarios.perception import fit_errors, write_errors


def main() -> int:
    """Run the benchmark; 1 if a target is missed."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.accuracy", description=__doc__
    )
    parser.add_argument("--folder", type=Path, default=Path(".slipstream/accuracy"))
    parser.add_argument("--only", default="", help="clips whose name contains this")
    parser.add_argument("--json", type=Path, help="also write all figures into a file")
    parser.add_argument("--states", type=Path, help="folder for what `slipstream robustness` reads")
    parser.add_argument("--errors", type=Path, help="write the error model that worlds use")
    options = parser.parse_args()
    chosen = [clip for clip in CLIPS if options.only in clip.name]
    if not chosen:
        parser.error(f"no clip's name contains {options.only!r}")
    settings = TrackSettings()
    compared: list[tuple[str, str, TrackComparison]] = []
    counted = {}
    alarms: list[str] = []
    with ProgressLine("clips", sys.stderr) as progress:
        for done, (clip, folder) in enumerate(make(options.folder, chosen), start=1):
            run, truth, camera = follow(folder, settings)
            comparison = compare(run.recorder, truth, camera, settings.stability)
            compared.append((clip.name, clip.world, comparison))
            counted[clip.name] = compare_counts(run.counts, truth, camera)
            if run.fault_s:
                alarms.append(f"{clip.name}: a fault that is none, {run.fault_s}")
            if options.states:
                options.states.mkdir(parents=True, exist_ok=True)
                lines = (state.to_bytes().decode() + "\n" for state in run.states)
                (options.states / f"{clip.name}.jsonl").write_text("".join(lines))
            progress.update(done, len(chosen))
    rows = [AccuracyRow(name, score([comparison])) for name, _, comparison in compared]
    totals = [
        AccuracyRow(world, score([c for _, of, c in compared if of == world]))
        for world in dict.fromkeys(world for _, world, _ in compared)
    ]
    total = AccuracyRow("all", score([comparison for _, _, comparison in compared]))
    print(table(rows, [*totals, total]))
    print()
    print(features(total.scores))
    print()
    print(classes(total.scores))
    of_clips = [(name, score_counts(pairs)) for name, pairs in counted.items()]
    all_counted = score_counts([pair for pairs in counted.values() for pair in pairs])
    print()
    print(counts([*of_clips, ("all", all_counted)]))
    if options.json:
        figures = {row.name: asdict(row.scores) for row in (*rows, *totals, total)}
        figures["counts"] = {name: asdict(one) for name, one in (*of_clips, ("all", all_counted))}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    if options.errors:
        windows = [window for _, _, comparison in compared for window in comparison.windows]
        command = "python -m slipstream_lab.benchmarks.accuracy --errors FILE"
        description = f"{len(chosen)} clips of {SECONDS} s; {command}"
        write_errors(fit_errors(windows, description), options.errors)
    missed = [*misses(total.scores), *count_misses(all_counted), *alarms]
    for miss in missed:
        print(f"missed: {miss}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
