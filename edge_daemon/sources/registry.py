"""Which source the settings ask for."""

from __future__ import annotations

from edge_daemon.settings import SourceSettings
from edge_daemon.sources.camera import open_camera
from edge_daemon.sources.clip import FastClip, open_clip, paced_clip
from edge_daemon.sources.protocol import FrameSource
from slipstream.errors import InputError


def open_source(settings: SourceSettings, size: tuple[int, int] | None = None) -> FrameSource:
    """Open the clip or camera that the settings ask for, with frames of (width, height), or of any
    size.

    Raises:
        InputError: as of `open_clip`. A camera need not be reachable yet.
    """
    if settings.clips:
        reader = open_clip(*settings.clips, loop=settings.loop, size=size, fps=settings.fps)
        return FastClip(reader) if settings.pace == "fast" else paced_clip(reader)
    if settings.url is None:
        raise InputError("source", "neither clip nor url", "give one of them")
    return open_camera(settings.url, settings.stall_timeout_s, size)
