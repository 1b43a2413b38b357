"""`slipstream calibrate`: from points in a picture to a camera.toml, with the grid to check it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError

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
        type=Path,
        required=True,
        help="the camera's picture, or a video of it: its first readable frame is taken",
    )
    command.add_argument(
        "--points",
        type=Path,
        required=True,
        help="TOML with [[points]] image = [u, v] (px), road = [x, y] (m), and [[segments]] as in "
        "a camera.toml; or CSV with columns u,v,x,y",
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
    from edge_daemon.calibration.calibration import calibrate
    from edge_daemon.calibration.files import (
        camera_toml,
        read_picture,
        read_points,
        reference_of,
        write_picture,
        write_whole,
    )
    from edge_daemon.calibration.overlay import draw_grid

    for target in (options.out, options.overlay):
        if target is not None and _same(target, options.image):
            raise InputError(target, "is the picture itself", "write to another file")
    if options.overlay is not None and options.overlay.absolute() == options.out.absolute():
        raise InputError(options.overlay, "is --out too", "write the overlay to another file")
    picture, is_video = read_picture(options.image)
    given = read_points(options.points)
    size = (picture.shape[1], picture.shape[0])
    if given.image is not None and size != (given.image.width, given.image.height):
        raise InputError(
            options.points,
            f"is for {given.image.width}×{given.image.height} px, "
            f"{options.image} has {size[0]}×{size[1]}",
            "take the points in the picture that is given",
            key="image",
        )
    before = read_points(options.out) if options.out.exists() else None
    # A camera that is calibrated anew keeps what it watches.
    segments = given.segments or (before.segments if before else ())
    calibration = calibrate(given.points, segments, size, options.points, given.lines, given.terms)
    name = options.name or given.name or (before.name if before else None) or options.out.stem
    reference = options.image
    if is_video:
        reference = options.out.with_name(f"{options.out.stem}-reference.png")
        write_picture(reference, picture)
    if options.overlay is not None:
        write_picture(options.overlay, draw_grid(picture, calibration))
    text = camera_toml(name, calibration, segments, reference_of(reference, options.out))
    write_whole(options.out, text.encode())
    print(json.dumps(_summary(calibration)) if options.json else _report(calibration, options.out))
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
        "pose": pose
        and {
            "foot_m": [float(c) for c in pose.foot_m],
            "height_m": pose.height_m,
            "focal_px": pose.focal_px,
        },
        "segments": [
            {
                "id": end.segment,
                "end": end.end,
                "point_m": end.point_m,
                "metres_per_px": end.metres_per_px,
                "reprojection_error_m": calibration.reprojection_error_px * end.metres_per_px,
                "position_error_m": end.position_error_m,
                "speed_error": end.speed_error,
            }
            for end in calibration.accuracy
        ],
        "warnings": calibration.warnings,
    }


def _report(calibration: Calibration, out: Path) -> str:
    rms = calibration.reprojection_error_px
    lines = [f"{out}: {calibration.used.sum()} points, reprojection error {rms:.2f} px"]
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
        f"{end.position_error_m:.2f} m, speed {end.speed_error:.1%}"
        for end in calibration.accuracy
    ]
    lines += [f"  look: {warning}" for warning in calibration.warnings]
    if not calibration.segments:
        lines.append("  no segments yet: add [[segments]] before an edge daemon can use it")
    return "\n".join(lines)
