"""`slipstream clip`: make a video with its ground truth and calibration."""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError
from slipstream_cli.progress import ProgressLine
from slipstream_lab.commands.sumo_files import add_options, sumo_files

if TYPE_CHECKING:
    from slipstream_lab.simulation.rsus import RsuSettings
    from slipstream_lab.simulation.streetdrive import ClipSummary


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
        epilog="Without --net, --routes and --rsu it shows a built-in avenue; a net of your own "
        "without --rsu is shown on its busiest approach.",
    )
    _add_common(sumo)
    sumo.add_argument("--net", help="SUMO net; built in: avenue")
    add_options(sumo, built_in="calm (default), mixed, rough")
    sumo.add_argument(
        "--rsu",
        "--rsu-file",
        help="RSU file (TOML); built in: approach (default), bend, crossing, departure, opposite",
    )
    sumo.add_argument("--rsu-id", metavar="ID", help="which RSU of a file with several")
    sumo.add_argument(
        "--begin",
        type=float,
        help="simulated second of the first frame (default: 120 s after the traffic begins)",
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
    world.add_argument("--seconds", type=float, default=30.0, help="length of the video")
    world.add_argument("--fps", type=float, default=30.0, help="frames per second")
    world.add_argument("--seed", type=int, default=1, help="same seed, same bytes")
    world.add_argument("--json", action="store_true", help="print a summary as JSON")


def run_streetdrive(options: argparse.Namespace) -> int:
    """Render a StreetDrive clip."""
    from slipstream_lab.simulation.streetdrive import ClipSettings, Conditions, render_clip

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
    with ProgressLine("rendering", sys.stderr) as progress:
        summary = render_clip(settings, options.out, progress.update)
    return _report(options, summary)


def run_sumo(options: argparse.Namespace) -> int:
    """Render a SUMO view."""
    from slipstream_lab.simulation.sumo import without_output
    from slipstream_lab.simulation.sumo_view import (
        SumoClipSettings,
        find_additional,
        find_net,
        find_routes,
        find_rsu,
        render_sumo_clip,
    )

    own = sumo_files(options)
    net = find_net("avenue" if own.net is None else str(own.net))
    names = [str(path) for path in own.routes] or ["calm"]
    routes = tuple(map(find_routes, names))
    begins_s = own.begin_s or 0.0
    camera = None
    if options.rsu is None and net != find_net("avenue"):
        camera = _busiest(net, routes)
    with tempfile.TemporaryDirectory() as folder, ProgressLine("rendering", sys.stderr) as progress:
        settings = SumoClipSettings(
            net=net,
            routes=routes,
            additional=without_output(find_additional(names[0], [*own.additional]), Path(folder)),
            rsu=net if camera is not None else find_rsu(options.rsu or "approach"),
            seconds=options.seconds,
            fps=options.fps,
            begin_s=begins_s + 120.0 if options.begin is None else options.begin,
            seed=options.seed,
            rsu_id=options.rsu_id,
            camera=camera,
            start_s=begins_s,
        )
        summary = render_sumo_clip(settings, options.out, progress.update)
    return _report(options, summary)


def _busiest(net: Path, routes: tuple[Path, ...]) -> RsuSettings:
    """A camera at the busiest approach of a net that has none."""
    from slipstream.roads.sumo_net import load_network
    from slipstream_lab.simulation.scenarios.networks import check_routes, count_passages
    from slipstream_lab.simulation.scenarios.perception import place_rsus
    from slipstream_lab.simulation.sumo import check_files
    from slipstream_lab.simulation.sumo_view import camera_site

    check_files(net, routes)
    network = load_network(net)
    check_routes(routes, network.segments)
    rsus = place_rsus(network, count_passages(routes, network), 1)
    if not rsus:
        raise InputError(net, "no road is long enough to choose a camera for", "give --rsu")
    print(f"slipstream: the camera watches {rsus[0].watch[0].segment}", file=sys.stderr)
    return camera_site(rsus[0], network)


def _report(options: argparse.Namespace, summary: ClipSummary) -> int:
    if options.json:
        print(json.dumps(asdict(summary), default=str))
    else:
        print(f"{options.out}: {summary.frames} frames, {summary.vehicles} vehicles")
    return 0
