"""Times as both feeds write them."""

from __future__ import annotations

from datetime import UTC, datetime


def iso_time(time_ns: int) -> str:
    """RFC 3339 with milliseconds, cut off.

    Args:
        time_ns: UTC, ≥ 0.
    """
    whole = datetime.fromtimestamp(time_ns // 10**9, UTC)
    return f"{whole:%Y-%m-%dT%H:%M:%S}.{time_ns % 10**9 // 10**6:03d}Z"


def window(time_ns: int, window_s: float) -> tuple[str, str]:
    """Begin and end of a window that ends at a time."""
    return iso_time(max(0, time_ns - round(window_s * 1e9))), iso_time(time_ns)
