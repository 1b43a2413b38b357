"""`slipstream clip`: make a video with its ground truth and calibration."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream_cli.progress import Progress

if TYPE_CHECKING:
    from simulation.streetdrive import ClipSummary


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser("clip", help="make a video with its ground truth")
    worlds = command.add_subparsers(dest="world", required=True, metavar="WORLD")
    street = worlds.add_parser("streetdrive", help="a rendered roadside view")
    _add_common(street)
    street.add_argument(
        "--scenario",
        choices=("stable", "turbulent", "mixed", "paper"),
        default="stable",
        help="calm traffic; stop-and-go; calm in, stop-and-go out; the paper's law of motion",
    )
    street.add_argument("--segment", default="approach", help="id of the watched road segment")
    _add_conditions(street)
    street.set_defaults(run=run_streetdrive)

    sumo = worlds.add_parser(
        "sumo",
        help="the same view of traffic that SUMO simulates",
        epilog="Without --net, --routes and --rsu it shows a built-in avenue.",
    )
    _add_common(sumo)
    sumo.add_argument("--net", default="avenue", help="SUMO net; built in: avenue")
    sumo.add_argument(
        "--routes", default="calm", help="SUMO route file; built in: calm, mixed, rough"
    )
    sumo.add_argument(
        "--additional", type=Path, action="append", default=[], help="SUMO additional file"
    )
    sumo.add_argument(
        "--rsu",
        default="approach",
        help="RSU file (TOML); built in: approach, bend, crossing, departure, opposite",
    )
    sumo.add_argument(
        "--begin", type=float, default=120.0, help="simulated second of the first frame"
    )
    sumo.set_defaults(run=run_sumo)


def _add_conditions(street: argparse.ArgumentParser) -> None:
    group = street.add_argument_group("weather, hour and camera; the truth does not depend on them")
    hour = group.add_mutually_exclusive_group()
    hour.add_argument("--night", action="store_true", help="street lamps and vehicle lamps")
    hour.add_argument("--low-sun", action="store_true", help="long shadows, glare")
    group.add_argument("--rain", type=float, default=0.0, metavar="MM_PER_HOUR", help="0 to 150")
    group.add_argument("--snow", type=float, default=0.0, metavar="MM_PER_HOUR", help="0 to 20")
    group.add_argument(
        "--visibility", type=float, default=math.inf, metavar="METRES", help="fog; 20 or more"
    )
    group.add_argument("--dirt", type=float, default=0.0, help="share of the lens, 0 to 1")
    group.add_argument(
        "--jpeg-quality", type=int, default=100, help="compression in the camera, 1 to 100"
    )
    group.add_argument(
        "--exposure-ms", type=float, default=0.0, help="motion blur, 0 to 100 milliseconds"
    )


def _add_common(world: argparse.ArgumentParser) -> None:
    world.add_argument("--out", type=Path, required=True, help="folder to write into")
    world.add_argument("--seconds", type=float, default=30.0)
    world.add_argument("--fps", type=int, default=30)
    world.add_argument("--seed", type=int, default=1, help="same seed, same bytes")
    world.add_argument("--json", action="store_true", help="print a summary as JSON")


def run_streetdrive(options: argparse.Namespace) -> int:
    """Render a StreetDrive clip."""
    from simulation.streetdrive import ClipSettings, Conditions, render_clip

    settings = ClipSettings(
        seconds=options.seconds,
        fps=options.fps,
        scenario=options.scenario,
        seed=options.seed,
        segment_id=options.segment,
        conditions=Conditions(
            night=options.night,
            low_sun=options.low_sun,
            rain_mm_h=options.rain,
            snow_mm_h=options.snow,
            visibility_m=options.visibility,
            dirt=options.dirt,
            jpeg_quality=options.jpeg_quality,
            exposure_s=options.exposure_ms / 1000,
        ),
    )
    with Progress("rendering", sys.stderr) as progress:
        summary = render_clip(settings, options.out, progress.update)
    return _report(options, summary)


def run_sumo(options: argparse.Namespace) -> int:
    """Render a SUMO view."""
    from simulation.sumo_view import (
        SumoClipSettings,
        find_additional,
        find_net,
        find_routes,
        find_rsu,
        render_sumo_clip,
    )

    settings = SumoClipSettings(
        net=find_net(options.net),
        routes=find_routes(options.routes),
        additional=find_additional(options.routes, options.additional),
        rsu=find_rsu(options.rsu),
        seconds=options.seconds,
        fps=options.fps,
        begin_s=options.begin,
        seed=options.seed,
    )
    with Progress("rendering", sys.stderr) as progress:
        summary = render_sumo_clip(settings, options.out, progress.update)
    return _report(options, summary)


def _report(options: argparse.Namespace, summary: ClipSummary) -> int:
    if options.json:
        print(json.dumps(asdict(summary), default=str))
    else:
        print(f"{options.out}: {summary.frames} frames, {summary.vehicles} vehicles")
    return 0
