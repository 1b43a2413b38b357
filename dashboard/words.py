"""The page's plain words: traffic, reasons, ages, and colours that all eyes can tell apart.

Colours are from Okabe and Ito's palette, made for colour-blind readers; no state is told by its
colour alone, each also has a line pattern on the map and a sign and a word in the tables.
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

# Blue, purple, near-black, pink, sky blue, brown: none of them near green, vermilion or grey.
VEHICLE_RGB: Final[tuple[Rgb, ...]] = (
    (0, 90, 181),
    (155, 48, 155),
    (35, 35, 45),
    (225, 60, 140),
    (60, 160, 225),
    (110, 60, 30),
)

_FAULTS: Final[dict[CameraFault, str]] = {
    "stale": "no picture",
    "dark": "picture black",
    "bright": "picture white",
    "obscured": "lens covered or out of focus",
    "frozen": "picture frozen",
    "corrupt": "pictures damaged",
    "camera_moved": "camera moved",
    "clock_jump": "clock jumped",
}

_REASONS: Final[dict[str, str]] = {
    "no_frames": "no picture from the camera",
    "too_few_vehicles": "too few vehicles to tell",
    "window_not_covered": "camera not watching long enough yet",
    "uncertain": "too uncertain to tell",
    "stale": "no fresh data",
    "dark": "the camera's picture is black",
    "bright": "the camera's picture is white",
    "obscured": "the camera's lens is covered or out of focus",
    "frozen": "the camera's picture is frozen",
    "corrupt": "the camera's pictures are damaged",
    "camera_moved": "the camera has moved",
    "clock_jump": "a clock has jumped",
    "future": "the camera's clock is ahead",
    "missing": "no data",
    "turbulent": "turbulent traffic",
}


def traffic(y_e: Literal[0, 1] | None) -> Traffic:
    """The word for a stability flag."""
    return "unknown" if y_e is None else "stable" if y_e else "turbulent"


def reason(code: str | None) -> str:
    """A reason code in plain words; codes not known here lose their underscores."""
    if not code:
        return ""
    code = code.removeprefix("unknown: ")
    return _REASONS.get(code, code.replace("_", " "))


def camera_fault(code: CameraFault) -> str:
    """A camera's fault in a word or two; one not known here loses its underscores."""
    return _FAULTS.get(code, code.replace("_", " "))


def why_closed(flag: Literal[0, 1] | None, code: str | None) -> str:
    """Why platooning is closed, from the gate's flag and reason."""
    if flag == 0:
        return "turbulent traffic"
    return reason(code) or "no data"


def duration(seconds: float) -> str:
    """A duration that reads at a glance: ``0.4 s``, ``12 s``, ``3 min``, ``5 h``, ``2 days``."""
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


def when(seconds: float) -> str:
    """A moment seen from now: ``in 12 s`` or ``3 min ago``."""
    return f"in {duration(seconds)}" if seconds > 0 else f"{duration(seconds)} ago"


def plural(count: int, one: str) -> str:
    """``1 road``, ``2 roads``."""
    return f"{count} {one}" if count == 1 else f"{count} {one}s"
