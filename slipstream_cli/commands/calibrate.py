"""`slipstream calibrate`: from points in a picture to a camera.toml, with the grid to check it."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from edge_daemon.settings import BUILTIN_MODEL
from slipstream.errors import InputError
from slipstream_cli.clip_options import add_fps

if TYPE_CHECKING:
    from edge_daemon.calibration.calibration import Calibration


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "calibrate",
        help="fit a camera to points known on the road",
        description="Fits a camera to at least four points known in the picture and on the road, "
        "states how well it measures, and draws the metric grid over the picture. "
        "docs/calibration.md says how to find the points.",
    )
    command.add_argument(
        "--image",
        required=True,
        help="the camera's picture, or a video of it: its first readable frame is taken; with "
        "--serve the median of some seconds, and a camera's URL is right too",
    )
    command.add_argument(
        "--serve",
        action="store_true",
        help="open a page on this machine to find the points in; its address is printed",
    )
    add_fps(command)
    command.add_argument(
        "--model",
        default=BUILTIN_MODEL,
        help="detector for the page's traffic and first guess, as edge.detector.model of site.toml",
    )
    command.add_argument(
        "--points",
        type=Path,
        help="TOML with [[points]] image = [u, v] (px), road = [x, y] (m), [[lines]] and "
        "[[segments]] as in a camera.toml; or CSV with columns u,v,x,y; "
        "with --serve those to begin with",
    )
    command.add_argument("--out", type=Path, required=True, help="the camera.toml to write")
    command.add_argument("--overlay", type=Path, help="a picture to write: grid, segments, points")
    command.add_argument(
        "--name", help="the camera's name (default: the points file's, or --out's)"
    )
    command.add_argument("--json", action="store_true", help="print the result as JSON")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Calibrate and report."""
    from edge_daemon.calibration.files import read_picture, read_points
    from edge_daemon.calibration.saving import save

    if options.serve:
        return _serve(options)
    if options.fps is not None:
        raise InputError("--fps", "is for --serve", "leave it out: one picture is taken")
    if options.points is None:
        raise InputError("--points", "is missing", "give a points file, or --serve to find points")
    image = Path(options.image)
    for target in (options.out, options.overlay):
        if target is not None and _same(target, image):
            raise InputError(target, "is the picture itself", "write to another file")
    if options.overlay is not None and options.overlay.absolute() == options.out.absolute():
        raise InputError(options.overlay, "is --out too", "write the overlay to another file")
    picture, is_video = read_picture(image)
    calibration = save(
        read_points(options.points),
        options.points,
        picture,
        None if is_video else image,
        options.out,
        name=options.name,
        overlay=options.overlay,
    )
    print(json.dumps(_summary(calibration)) if options.json else _report(calibration, options.out))
    return 0


def _serve(options: argparse.Namespace) -> int:
    from edge_daemon.calibration.files import read_points
    from edge_daemon.calibration.page import PageServer
    from edge_daemon.calibration.recording import record
    from edge_daemon.calibration.session import Session

    for name, given in (("--overlay", options.overlay), ("--json", options.json)):
        if given:
            raise InputError(name, "is not for --serve", "leave it out: the page shows the result")
    if _same(options.out, Path(options.image)):
        raise InputError(options.out, "is the picture itself", "write to another file")
    start = options.points or (options.out if options.out.exists() else None)
    points = None if start is None else read_points(start)
    recording = record(options.image, options.fps)
    height, width = recording.picture.shape[:2]
    if options.points is None and points is not None and points.image is not None:
        was = points.image.width, points.image.height
        if was != (width, height):
            # Such as those that `slipstream init` has made up: of another picture, so of no use.
            print(
                f"{options.out}: its points are in a picture of {was[0]}×{was[1]} px, this one "
                f"has {width}×{height}: they are left out, its segments stay"
            )
            points = None
    still = None if recording.times_s else Path(options.image)
    session = Session(recording, still, options.out, options.model, points, options.name)
    with PageServer(session) as server:
        print(f"open {server.url}\nCtrl-C ends it", flush=True)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


def _same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def _summary(calibration: Calibration) -> dict[str, object]:
    pose = calibration.pose
    return {
        "reprojection_error_px": calibration.reprojection_error_px,
        "click_error_px": calibration.click_px,
        "points": [
            # JSON has no infinity: a point behind the horizon misses by null.
            {"miss_px": float(miss) if miss == miss else None, "used": bool(used)}
            for miss, used in zip(calibration.residuals_px, calibration.used, strict=True)
        ],
        "terms": calibration.terms,
        "pose": pose
        and {
            "foot_m": [float(c) for c in pose.foot_m],
            "height_m": pose.height_m,
            "focal_px": pose.focal_px,
        },
        "segments": [
            {
                "id": end.segment,
                "reprojection_error_m": calibration.reprojection_error_px * end.metres_per_px,
                **{name: value for name, value in end.as_json().items() if name != "segment"},
            }
            for end in calibration.accuracy
        ],
        "warnings": calibration.warnings,
    }


def _report(calibration: Calibration, out: Path) -> str:
    rms = calibration.reprojection_error_px
    lines = [f"{out}: {calibration.used.sum()} points, reprojection error {rms:.2f} px"]
    if calibration.terms:
        lines.append(f"  the points ask for more than a plane: {_told(calibration)}")
    if calibration.pose is not None:
        pose = calibration.pose
        x, y = (round(float(c), 1) + 0.0 for c in pose.foot_m)  # no "-0.0"
        lines.append(
            f"  camera {pose.height_m:.1f} m above the road at ({x:.1f}, {y:.1f}), "
            f"focal length {pose.focal_px:.0f} px"
        )
    lines += [
        f"  {end.segment}, {end.end} end: 1 px is {end.metres_per_px:.2f} m, reprojection error "
        f"{rms * end.metres_per_px:.2f} m; clicks {calibration.click_px:.1f} px off: "
        + (
            f"{end.position_error_m:.2f} m, speed {end.speed_error:.1%}"
            if end.is_sure
            else "not measured"
        )
        for end in calibration.accuracy
    ]
    lines += [f"  look: {warning}" for warning in calibration.warnings]
    if not calibration.segments:
        lines.append("  no segments yet: add [[segments]] before an edge daemon can use it")
    return "\n".join(lines)


def _told(calibration: Calibration) -> str:
    from edge_daemon.camera.curved import CurvedRoad

    road = calibration.projection
    assert isinstance(road, CurvedRoad)
    told = {
        "lens": f"distortion of {road.distortion:+.1%} at the corners",
        "arc": f"an arc of {1 / (abs(road.curvature_per_m) or 1e-9):.0f} m radius",
        "crest": f"{'a sag' if road.bend_per_m > 0 else 'a crest'} of "
        f"{1 / (abs(road.bend_per_m) or 1e-9):.0f} m radius",
    }
    return ", ".join(told[term] for term in calibration.terms)
