"""`python -m slipstream_lab.benchmarks.accuracy.weather`: the flag in weather, at night and with
bad pictures.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from edge_daemon.settings import TrackSettings
from slipstream.messages import SegmentState
from slipstream_cli.progress import ProgressLine
from slipstream_cli.tables import markdown_table
from slipstream_lab.benchmarks.accuracy.clips import WEATHER, follow, make
from slipstream_lab.research.perception import TrackComparison, compare, true_windows
from slipstream_lab.simulation.ground_truth import TrueWindow


@dataclass(frozen=True)
class Flags:
    """The flags of one condition against the truth, in windows."""

    windows: int
    known: int
    right: int
    wrongly_stable: int
    unknown: dict[str, int]
    followed: float


def flags_of(
    windows: Sequence[tuple[SegmentState, TrueWindow]], comparisons: Sequence[TrackComparison]
) -> Flags:
    """Count the flags of some clips."""
    known = [(state, true) for state, true in windows if state.y_e is not None]
    followed = [mark for comparison in comparisons for mark in comparison.boxes.followed.tolist()]
    return Flags(
        windows=len(windows),
        known=len(known),
        right=sum(state.y_e == true.y_e for state, true in known),
        wrongly_stable=sum(state.y_e == 1 and true.y_e == 0 for state, true in known),
        unknown=dict(
            Counter(state.reason or "" for state, _ in windows if state.y_e is None).most_common()
        ),
        followed=sum(followed) / max(1, len(followed)),
    )


def table(found: dict[str, Flags]) -> str:
    """One row a condition."""
    columns = ("clips in", "followed", "windows", "known", "right", "stable in turbulence", "why")
    rows = (
        (
            condition,
            f"{flags.followed:.1%}",
            flags.windows,
            f"{flags.known / max(1, flags.windows):.0%}",
            f"{flags.right / flags.known:.0%}" if flags.known else "–",
            flags.wrongly_stable,
            ", ".join(f"{reason} {count}" for reason, count in flags.unknown.items()) or "–",
        )
        for condition, flags in found.items()
    )
    return markdown_table(columns, rows, left=(0, 6))


def main() -> int:
    """Run the benchmark; 1 if a flag is stable where the truth is turbulent."""
    parser = argparse.ArgumentParser(prog="python -m slipstream_lab.benchmarks.accuracy.weather")
    parser.add_argument("--folder", type=Path, default=Path(".slipstream/weather"))
    parser.add_argument("--only", default="", help="conditions whose name contains this")
    parser.add_argument("--json", type=Path, help="also write all figures into a file")
    options = parser.parse_args()
    chosen = {name: clips for name, clips in WEATHER.items() if options.only in name}
    if not chosen:
        parser.error(f"no condition's name contains {options.only!r}")
    settings = TrackSettings()
    found = {}
    with ProgressLine("conditions", sys.stderr) as progress:
        for condition, clips in chosen.items():
            comparisons: list[TrackComparison] = []
            windows: list[tuple[SegmentState, TrueWindow]] = []
            for _, folder in make(options.folder, clips):
                run, truth, camera = follow(folder, settings)
                recorded, rule = run.recorder, settings.stability
                comparisons.append(compare(recorded, truth, camera, rule))
                windows += true_windows(recorded, truth, camera, rule)
            found[condition] = flags_of(windows, comparisons)
            progress.update(len(found), len(chosen))
    print(table(found))
    if options.json:
        figures = {condition: asdict(flags) for condition, flags in found.items()}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")
    return 1 if any(flags.wrongly_stable for flags in found.values()) else 0


if __name__ == "__main__":
    raise SystemExit(main())
