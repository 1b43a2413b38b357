"""`slipstream track`: follow one recorded video offline and say how well it went."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from edge_daemon.settings import DetectorSettings, TrackSettings
from slipstream.config import check
from slipstream.errors import InputError
from slipstream_cli.clip_options import add_config, add_fps, settings_of
from slipstream_cli.laboratory import part
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from slipstream.messages import Estimate, SegmentCounts


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "track",
        help="follow one video: segment states out, figures beside the truth",
        description="Follow the vehicles of one recorded video, every frame, as fast as it goes. "
        "Segment states go into a file, one JSON object a line; a summary is printed.",
    )
    command.add_argument("video", type=Path, help="a video file")
    command.add_argument("--camera", type=Path, required=True, help="its calibration, a TOML file")
    command.add_argument(
        "--out",
        type=Path,
        help="file for the states (default: the video's name .states.jsonl, here)",
    )
    command.add_argument("--truth", type=Path, help="truth.csv of `slipstream clip`: adds scores")
    command.add_argument("--annotated", type=Path, metavar="MP4", help="write the video drawn over")
    command.add_argument("--model", default=None, help="another YOLO11 export (.xml, folder, .pt)")
    command.add_argument("--full", action="store_true", help="search the whole picture")
    add_fps(command)
    add_config(command)
    for option, default, text in (
        ("--threads", DetectorSettings().threads, "inference threads; 0: one per CPU core"),
        ("--window", TrackSettings().window_s, "length of the feature window, s"),
        ("--every", TrackSettings().state_interval_s, "time between two states of a segment, s"),
    ):
        command.add_argument(
            option, type=type(default), help=f"{text} (default: that of --config, or {default})"
        )
    command.add_argument(
        "--bare",
        action="store_true",
        help="the paper's rule by the values alone, without error bars",
    )
    command.add_argument("--json", action="store_true", help="print the summary as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Track, write the states, print the summary."""
    from edge_daemon.camera import load_camera
    from edge_daemon.offline import frame_times_ms, track

    camera = load_camera(options.camera)
    scores = part("score", "--truth")(options.truth, camera) if options.truth else None
    settings = _settings(options)
    if options.bare:
        settings = settings.model_copy(update={"stability": settings.stability.bare()})
    out = options.out or Path(f"{options.video.stem}.states.jsonl")
    with _whole_or_not(out) as states, ProgressLine("tracking", sys.stderr) as progress:
        result = track(
            options.video,
            camera,
            settings,
            fps=options.fps,
            annotated=options.annotated,
            progress=progress.update,
        )
        states.writelines(state.to_bytes().decode() + "\n" for state in result.states)
    median, p95, latency_median, latency_p95 = frame_times_ms(result)
    known = [state.y_e for state in result.states if state.y_e is not None]
    summary: dict[str, Any] = {
        "video": str(options.video),
        "states_file": str(out),
        "frames": len(result.done_s),
        "fps": round(result.rate.fps, 3),
        "fps_from": result.rate.source,
        "gap_s": round(result.gap_s, 1),
        "decode_errors": result.decode_errors,
        "fault_s": {fault: round(seconds, 1) for fault, seconds in result.fault_s.items()},
        "states": len(result.states),
        "stable": sum(known),
        "turbulent": len(known) - sum(known),
        "unknown": len(result.states) - len(known),
        "unknown_for": dict(Counter(s.reason for s in result.states if s.reason is not None)),
        "counts": [_counted(counts) for counts in result.counts],
        "ms_per_frame": {"median": round(median, 2), "p95": round(p95, 2)},
        "latency_ms": {"median": round(latency_median, 2), "p95": round(latency_p95, 2)},
        "rss_mb": round(result.rss_mb, 1),
    }
    if scores is not None:
        summary |= scores(result.recorder, settings.stability)
    print(json.dumps(summary) if options.json else _in_words(summary))
    return 0


def _counted(counts: SegmentCounts) -> dict[str, Any]:
    """What passed on a segment in a quarter hour of the clip, with standard errors."""

    def rounded(estimate: Estimate | None, factor: float = 1.0) -> list[float | None] | None:
        if estimate is None:
            return None
        error = estimate.standard_error
        return [
            round(factor * estimate.value, 1),
            None if error is None else round(factor * error, 2),
        ]

    return {
        "segment": counts.segment,
        "from_s": counts.began_ns / 1e9,
        "watched_s": round(counts.watched_s, 1),
        "reason": counts.reason,
        "vehicles": rounded(counts.vehicles),
        **{one.vehicle_class: rounded(one.vehicles) for one in counts.classes},
        "flow_vph": rounded(counts.flow_vph(counts.vehicles)),
        "mean_speed_kmh": rounded(counts.mean_speed_mps, 3.6),
        "v85_kmh": rounded(counts.v85_mps, 3.6),
    }


def _settings(options: argparse.Namespace) -> TrackSettings:
    """Those of `--config` or the defaults, with what the command line says instead."""
    base = settings_of(options)
    given = {"window_s": options.window, "state_interval_s": options.every}
    searched = {"model": options.model, "threads": options.threads}
    if options.full:
        searched["region"] = False
    detector = base.detector.model_dump() | _without_none(searched)
    fields = {name: getattr(base, name) for name in ("window_s", "state_interval_s")}
    checked = check(
        {**fields, **_without_none(given), "detector": detector}, TrackSettings, "command line"
    )
    kept = {name: getattr(base, name) for name in ("stability", "watch")}
    return checked.model_copy(update=kept)


def _without_none(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


@contextmanager
def _whole_or_not(path: Path) -> Iterator[TextIO]:
    """A file to write that takes its name when all went well; what had the name stays till then."""
    target = path.resolve()
    # Devices and pipes are written as they are.
    plain = target.is_file() or not target.exists()
    part = target.with_name(f"{target.name}.part") if plain and target.name else target
    try:
        file = part.open("w", encoding="utf-8")
    except OSError as error:
        raise InputError(
            path, f"cannot be written ({error.strerror})", "give another file"
        ) from None
    try:
        with file:
            yield file
        if part != target:
            part.replace(target)
    finally:
        if part != target:
            part.unlink(missing_ok=True)


def _in_words(summary: dict[str, Any]) -> str:
    lines = []
    for key, value in summary.items():
        if key == "features":
            lines += [f"  {name}: {_in_row(figures)}" for name, figures in value.items()]
        elif key == "counts":
            lines += [f"counted on {one['segment']}: {_counts_in_row(one)}" for one in value]
        else:
            row = (_in_row(value) or "none") if isinstance(value, dict) else _short(value)
            lines.append(f"{key}: {row}")
    return "\n".join(lines)


def _in_row(values: dict[str, Any]) -> str:
    return ", ".join(f"{key} {_short(value)}" for key, value in values.items())


def _counts_in_row(counted: dict[str, Any]) -> str:
    told = [f"watched {counted['watched_s']:g} s from {counted['from_s']:g} s on"]
    told += [f"because of {counted['reason']}"] if counted["reason"] else []
    for name, value in counted.items():
        if isinstance(value, list):
            error = "" if value[1] is None else f" ± {value[1]:.2g}"
            told.append(f"{name} {value[0]:g}{error}")
    return ", ".join(told)


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
