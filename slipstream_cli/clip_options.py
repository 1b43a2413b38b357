"""Options of the commands that read a recorded clip: its rate, and a roadside unit's settings."""

from __future__ import annotations

import argparse
from pathlib import Path

from edge_daemon.settings import MAX_FPS, EdgeSettings, TrackSettings
from slipstream.site import load_site


def frame_rate(text: str) -> float:
    """Frames a second, of an option."""
    try:
        fps = float(text)
    except ValueError:
        fps = 0.0
    if not 0 < fps <= MAX_FPS:
        raise argparse.ArgumentTypeError(f"{text!r} is not above 0 and at most {MAX_FPS:g}")
    return fps


def add_fps(command: argparse.ArgumentParser) -> None:
    """Add `--fps`."""
    command.add_argument(
        "--fps",
        type=frame_rate,
        help="frames a second that it was filmed at, for a clip that does not say it, as raw "
        "H.264 or MJPEG; goes before what the clip says (default: as it says)",
    )


def add_config(command: argparse.ArgumentParser) -> None:
    """Add `--config`."""
    command.add_argument(
        "--config",
        type=Path,
        metavar="SITE.toml",
        help="settings of a roadside unit to take detector, tracker, stability and watch from "
        "(default: those that a site.toml without them has)",
    )
    command.add_argument(
        "--rsu", metavar="NAME", help="the roadside unit (default: the only one of the site.toml)"
    )


def settings_of(options: argparse.Namespace) -> TrackSettings:
    """What `--config` says, or else the defaults.

    Raises:
        InputError: the file cannot be used.
    """
    if options.config is None:
        return TrackSettings()
    return load_site(options.config, "edge", EdgeSettings, options.rsu)
