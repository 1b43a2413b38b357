"""Labels and colours of the page: traffic states, reason codes, durations.

State colours are from Okabe and Ito's palette for colour-blind readers. No state is shown by its
colour alone: each also has a dash pattern on the map, and a sign and a word in the tables.
"""

from __future__ import annotations

from typing import Final, Literal

from slipstream.messages import CameraFault

Traffic = Literal["stable", "turbulent", "unknown"]
Level = Literal["ok", "warn", "bad"]
Rgb = tuple[int, int, int]

TRAFFIC_RGB: Final[dict[Traffic, Rgb]] = {
    "stable": (0, 158, 115),
    "turbulent": (213, 94, 0),
    "unknown": (128, 136, 148),
}
TRAFFIC_SIGN: Final[dict[Traffic, str]] = {"stable": "✓", "turbulent": "✕", "unknown": "?"}
TRAFFIC_DASHES: Final[dict[Traffic, str]] = {"stable": "", "turbulent": "10 5", "unknown": "5 5"}
"""Dash patterns as in SVG's `stroke-dasharray`, px."""
LEVEL_RGB: Final[dict[Level, Rgb]] = {
    "ok": (0, 128, 94),
    "warn": (176, 104, 0),
    "bad": (190, 50, 20),
}
LEVEL_SIGN: Final[dict[Level, str]] = {"ok": "●", "warn": "▲", "bad": "■"}

VEHICLE_RGB: Final[tuple[Rgb, ...]] = (
    (0, 105, 255),
    (90, 0, 0),
    (60, 0, 105),
    (75, 150, 0),
    (210, 90, 150),
    (0, 0, 165),
    (150, 15, 105),
    (0, 0, 255),
    (45, 105, 15),
    (105, 60, 180),
    (150, 90, 90),
    (135, 120, 210),
)
"""Colours that tell vehicles apart, also for readers without red or green cones, on light ground.
Each is among the farthest from those before it."""

CYCLE_STATUS: Final[dict[str, tuple[str, Level]]] = {
    "ok": ("ok", "ok"),
    "baseline": ("baseline plan used", "warn"),
    "failed": ("failed", "bad"),
}

_FAULTS: Final[dict[CameraFault, str]] = {
    "stale": "no picture",
    "dark": "picture black",
    "bright": "picture white",
    "obscured": "lens covered or out of focus",
    "frozen": "picture frozen",
    "corrupt": "pictures damaged",
    "camera_moved": "camera moved",
    "clock_jump": "clock jumped",
    "blind": "vehicles not recognised",
}

_REASONS: Final[dict[str, str]] = {
    "no_frames": "no picture from the camera",
    "too_few_vehicles": "too few vehicles to tell",
    "not_running": "the roadside unit had not started yet",
    "low_frame_rate": "the camera sends too few pictures a second",
    "window_not_covered": "camera not watching long enough yet",
    "implausible": "measured accelerations that no traffic has",
    "opposite_direction": "traffic runs the other way: turn the segment round in the calibration",
    "wrong_way": "a vehicle drives the wrong way",
    "uncertain": "too uncertain to tell",
    "stale": "no fresh data",
    "dark": "the camera's picture is black",
    "bright": "the camera's picture is white",
    "obscured": "the camera's lens is covered or out of focus",
    "frozen": "the camera's picture is frozen",
    "corrupt": "the camera's pictures are damaged",
    "camera_moved": "the camera has moved",
    "clock_jump": "a clock has jumped",
    "blind": "something moves that the detector does not recognise",
    "future": "the camera's clock is ahead",
    "missing": "no data",
    "turbulent": "turbulent traffic",
}


def traffic(y_e: Literal[0, 1] | None) -> Traffic:
    """The traffic state of a stability flag."""
    return "unknown" if y_e is None else "stable" if y_e else "turbulent"


def reason(code: str | None) -> str:
    """Label of a reason code; an unknown code with spaces for its underscores."""
    if not code:
        return ""
    return _REASONS.get(code, code.replace("_", " "))


def camera_fault(code: CameraFault) -> str:
    """Short label of a camera's fault; of one not known here, its code without underscores."""
    return _FAULTS.get(code, code.replace("_", " "))


def gate_reason(flag: Literal[0, 1] | None, code: str | None) -> str:
    """Label of why a gate is closed, from its flag and reason code."""
    if flag == 0:
        return "turbulent traffic"
    return reason(code) or "no data"


def duration(seconds: float) -> str:
    """A duration in one unit: ``0.4 s``, ``12 s``, ``3 min``, ``5 h``, ``2 days``."""
    seconds = abs(seconds)
    if seconds < 1.95:
        return f"{seconds:.1f} s"
    if seconds < 99.5:
        return f"{seconds:.0f} s"
    if seconds < 99.5 * 60:
        return f"{seconds / 60:.0f} min"
    if seconds < 47.5 * 3600:
        return f"{seconds / 3600:.0f} h"
    return f"{seconds / 86400:.0f} days"


def plural(count: int, one: str) -> str:
    """A count with its noun: ``1 road``, ``2 roads``."""
    return f"{count} {one}" if count == 1 else f"{count} {one}s"
