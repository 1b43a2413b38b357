"""`slipstream clip`: make a video with its ground truth and calibration."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from slipstream_cli.progress import Progress


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("clip", help="make a video with its ground truth")
    worlds = command.add_subparsers(dest="world", required=True, metavar="WORLD")
    street = worlds.add_parser("streetdrive", help="a rendered roadside view")
    street.add_argument("--out", type=Path, required=True, help="folder to write into")
    street.add_argument("--seconds", type=float, default=30.0)
    street.add_argument("--fps", type=int, default=30)
    street.add_argument(
        "--scenario",
        choices=("stable", "turbulent", "mixed", "paper"),
        default="stable",
        help="calm traffic; stop-and-go; calm in, stop-and-go out; the paper's law of motion",
    )
    street.add_argument("--seed", type=int, default=1, help="same seed, same bytes")
    street.add_argument("--segment", default="approach", help="id of the watched road segment")
    street.add_argument("--json", action="store_true", help="print a summary as JSON")
    street.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Render the clip."""
    from simulation.streetdrive.clip import ClipSettings, render_clip

    settings = ClipSettings(
        seconds=options.seconds,
        fps=options.fps,
        scenario=options.scenario,
        seed=options.seed,
        segment_id=options.segment,
    )
    with Progress("rendering", sys.stderr) as progress:
        summary = render_clip(settings, options.out, progress.update)
    if options.json:
        print(json.dumps(asdict(summary), default=str))
    else:
        print(f"{options.out}: {summary.frames} frames, {summary.vehicles} vehicles")
    return 0
