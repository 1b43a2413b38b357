"""Prometheus metrics of an edge daemon."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

FRAMES = Counter("slipstream_edge_frames", "Frames processed")
SKIPPED = Gauge("slipstream_edge_frames_skipped", "Frames skipped for lack of time, or in a burst")
REPEATED = Gauge("slipstream_edge_frames_repeated", "Frames left out as they repeat the one before")
DECODE_ERRORS = Gauge("slipstream_edge_decode_errors", "Frames or clip ends that were unreadable")
RECONNECTS = Gauge("slipstream_edge_reconnects", "Times the camera had to be connected again")
STATES = Counter("slipstream_edge_segment_states", "Segment states published", ["segment", "flag"])
FAULT = Gauge("slipstream_edge_camera_fault", "1 while the camera has this fault", ["reason"])
FAULTS = Counter("slipstream_edge_camera_faults", "Camera faults that began", ["reason"])
LATENCY = Histogram(
    "slipstream_edge_latency_seconds",
    "Frame captured to tracks updated",
    buckets=(0.002, 0.004, 0.008, 0.016, 0.022, 0.033, 0.05, 0.1, 0.2, 0.5, 1.0),
)
