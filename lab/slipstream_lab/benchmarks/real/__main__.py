"""`make bench-real DATA=DIR`: speeds and boxes of real roads; nothing of DIR is kept.

Speeds: DIR/brno with BrnoCompSpeed's truth and positions. Boxes: DIR/*.mp4, a clip that labels of
this package were drawn on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np

from edge_daemon.detection import open_detector
from edge_daemon.detection.protocol import MIN_SCORE
from edge_daemon.settings import BUILTIN_MODEL, DetectorSettings
from edge_daemon.tracking import HIGH_SCORE
from slipstream_lab.benchmarks.aims import Check
from slipstream_lab.benchmarks.command import Measured, report, say, start
from slipstream_lab.benchmarks.real.boxes import (
    BoxScore,
    detect,
    find_clip,
    load_labels,
    read_frames,
    score_boxes,
)
from slipstream_lab.benchmarks.real.brno import find_recordings, load_recording
from slipstream_lab.benchmarks.real.cameras import distance_errors, from_survey
from slipstream_lab.benchmarks.real.report import (
    ON_ROAD,
    RAISED,
    box_lines,
    checks,
    render,
    speed_lines,
)
from slipstream_lab.benchmarks.real.score import (
    Matched,
    SpeedFigures,
    figures,
    match,
    point_height_m,
)
from slipstream_lab.benchmarks.real.speeds import measure

LABELS: Final = Path(__file__).parent / "labels"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 0 too where there is no data, which it says."""
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.benchmarks.real", description=__doc__
    )
    parser.add_argument("--data", type=Path, required=True, help="the folder DIR")
    parser.add_argument("--model", action="append", default=[], help="also score this model")
    parser.add_argument("--out", type=Path, default=Path(".slipstream/bench-real"))
    parser.add_argument("--json", action="store_true", help="print the report as JSON")
    options = parser.parse_args(arguments)
    brno, clips = find_recordings(options.data / "brno"), _labelled_clips(options.data)
    if not brno and not clips:
        say(
            f"bench-real: skipped, {options.data} holds no recordings in brno/ and no labelled clip"
        )
        return 0

    def run() -> Measured:
        tables, lines = _speeds(brno)
        models = [BUILTIN_MODEL, *options.model]
        boxes = {
            f"{model}, score ≥ {score:g}": _boxes(clips, model, score)
            for model in (models if clips else ())
            for score in (HIGH_SCORE, MIN_SCORE)
        }
        found: list[Check] = checks(tables)
        options.out.mkdir(parents=True, exist_ok=True)
        text = render([*lines, *box_lines(boxes)], found)
        (options.out / "report.md").write_text(text, encoding="utf-8")
        data = {
            "speeds": {
                name: {camera: asdict(row) for camera, row in rows.items()}
                for name, rows in tables.items()
            },
            "boxes": {name: [asdict(row) for row in rows] for name, rows in boxes.items()},
            "checks": [asdict(check) for check in found],
        }
        (options.out / "report.json").write_text(json.dumps(data, indent=1), encoding="utf-8")
        return Measured(options.out, found)

    return report("bench-real", run, as_json=options.json)


def _speeds(
    files: Sequence[tuple[Path, Path]],
) -> tuple[dict[str, dict[str, SpeedFigures]], list[str]]:
    """The figures by way of measuring and camera, and the report's lines."""
    measured: dict[str, tuple[str, Matched, float]] = {}
    lines = ["## Cameras", "", "| camera | height, m | focal length, px | distances, worst % |"]
    lines.append("|---|--:|--:|--:|")
    for truth, tracks in files:
        recording = load_recording(truth, tracks)
        say(f"{recording.name}: {len(recording.tracks)} tracks")
        surveyed = from_survey(recording)
        matched = match(recording.passages, measure(recording, surveyed))
        measured[recording.name] = recording.session, matched, surveyed.height_m
        pose = surveyed.camera.pose
        worst = 100 * np.abs(distance_errors(recording, surveyed)).max()
        lines.append(
            f"| {recording.name} | {surveyed.height_m:.2f} "
            f"| {pose.focal_px if pose else float('nan'):.0f} | {worst:.2f} |"
        )
    tables = {ON_ROAD: _rows({name: matched for name, (_, matched, _) in measured.items()})}
    raised = {}
    for name, (session, matched, height_m) in measured.items():
        # What a session is corrected by comes from the others.
        others = [(m, h) for s, m, h in measured.values() if s != session and len(m.true_kmh)]
        if len(others) > 1:
            point_m, spread_m = point_height_m(others)
            raised[name] = matched.higher(point_m / height_m, spread_m / height_m)
    if raised:
        tables[RAISED] = _rows(raised)
    return tables, [*lines, "", *speed_lines(tables)] if files else []


def _rows(matched: dict[str, Matched]) -> dict[str, SpeedFigures]:
    """Figures of each camera and of all."""
    every = {**matched, "all": Matched.join(list(matched.values()))} if matched else {}
    rows = {name: figures(each) for name, each in every.items()}
    return {name: row for name, row in rows.items() if row is not None}


def _labelled_clips(folder: Path) -> list[tuple[Path, Path]]:
    """Files of labels, each with its clip in the folder."""
    pairs = []
    for path in sorted(LABELS.glob("*.csv")):
        clip = find_clip(load_labels(path), folder)
        if clip is not None:
            pairs.append((path, clip))
    return pairs


def _boxes(clips: Sequence[tuple[Path, Path]], model: str, score: float) -> list[BoxScore]:
    detector = open_detector(DetectorSettings(model=model))
    labelled, found = {}, {}
    for number, (path, clip) in enumerate(clips):
        boxes = load_labels(path).boxes
        for frame, of_frame in detect(detector, read_frames(clip, list(boxes)), score).items():
            key = number * 10**6 + frame
            labelled[key], found[key] = boxes[frame], of_frame
    return score_boxes(labelled, found)


if __name__ == "__main__":
    start(main)
