"""What an edge publishes beside states and health: stopped vehicles, counts, and pictures."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Final

import cv2

from edge_daemon.camera import Camera
from edge_daemon.features.quarter_hours import QuarterHours
from edge_daemon.frame import Frame, Image
from edge_daemon.preview import annotate, draw_time, past_picture, scaled, utc_date_and_time
from edge_daemon.settings import EdgeSettings
from edge_daemon.tracking import Track
from slipstream.bus import Bus, Publisher
from slipstream.messages import (
    SegmentState,
    StoppedVehicles,
    bare_preview_key,
    counts_key,
    preview_key,
    running_counts_key,
    stopped_key,
    with_capture_time,
)
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

_WIDTH_PX: Final = 640
_JPEG_QUALITY: Final = 70
_RUNNING_S: Final = 60.0


class StoppedPublisher:
    """Publishes segments' stopped vehicles, and once that there are none any more."""

    def __init__(self, rsu: str, camera: Camera, bus: Bus) -> None:
        self._publishers = {
            segment.id: bus.publisher(stopped_key(rsu, segment.id), history=0)
            for segment in camera.segments
        }
        self._standing: set[str] = set()
        self._warned: set[str] = set()
        self._limiter = LogLimiter()

    def publish(self, stopped: StoppedVehicles) -> None:
        """What stands on a segment that can be seen."""
        segment = stopped.segment
        if not stopped.vehicles and segment not in self._standing:
            return
        self._publishers[segment].put(stopped)
        if stopped.vehicles:
            self._standing.add(segment)
        else:
            self._standing.discard(segment)
        unusual = stopped.unusual
        if unusual and segment not in self._warned:
            if self._limiter.allow(segment):
                self._warned.add(segment)
                log.warning(
                    "%s: %d stopped as in no queue, the first in lane %d from the right at %.0f m",
                    segment,
                    len(unusual),
                    unusual[0].lane + 1,
                    unusual[0].along_m,
                )
        elif not stopped.vehicles and segment in self._warned:
            self._warned.discard(segment)
            log.warning("%s: no vehicle stands any more", segment)

    def forget(self) -> None:
        """Say no more of who stood: whether they still do is not known."""
        self._standing.clear()
        self._warned.clear()


class CountsPublisher:
    """Publishes the counts of quarter hours that are complete, and each minute those of the running
    one.
    """

    def __init__(self, rsu: str, camera: Camera, bus: Bus) -> None:
        self._publishers = {
            segment.id: (
                bus.publisher(counts_key(rsu, segment.id)),
                bus.publisher(running_counts_key(rsu, segment.id), history=0),
            )
            for segment in camera.segments
        }
        self._told_s = dict.fromkeys(self._publishers, -math.inf)

    def publish(self, segment: str, counts: QuarterHours, now_s: float) -> None:
        """What there is to tell of a segment at a monotonic time."""
        complete, running = self._publishers[segment]
        for told in counts.complete(segment):
            complete.put(told)
        present = counts.running(segment)
        if present is not None and now_s - self._told_s[segment] >= _RUNNING_S:
            self._told_s[segment] = now_s
            running.put(present)


_DIRECTIONS: Final = {
    "opposite_direction": "the traffic runs the other way; turn the segment round",
    "wrong_way": "a vehicle drives against the traffic",
}


def warn_of_direction(state: SegmentState, limiter: LogLimiter) -> None:
    """Log that a segment is drawn against its traffic, or that somebody drives against it."""
    told = _DIRECTIONS.get(state.reason or "")
    if told is not None:
        limiter.warn(log, f"{state.reason} {state.segment}", f"{state.segment}: {told}")


class Previews:
    """Publishes pictures while somebody looks, with boxes and without."""

    def __init__(self, settings: EdgeSettings, camera: Camera, bus: Bus) -> None:
        self._camera = camera
        keys = {preview_key(settings.rsu): True, bare_preview_key(settings.rsu): False}
        self._publishers: list[tuple[Publisher, bool]] = [
            (bus.publisher(key, best_effort=True), boxes)
            for key, boxes in keys.items()
            if settings.preview.fps > 0
        ]

    def publish(
        self, frame: Frame, tracks: Sequence[Track], states: Mapping[str, SegmentState]
    ) -> None:
        """A frame, with what is known of it."""
        width = _WIDTH_PX
        for publisher, boxes in self._publishers:
            if not publisher.has_subscribers():
                continue
            if boxes:
                media_s = frame.media_time_s
                picture = annotate(frame.image, self._camera, tracks, states, media_s, width)
            else:
                picture = scaled(frame.image, width)
            draw_time(picture, utc_date_and_time(frame.captured_ns))
            self._put(publisher, picture, frame.captured_ns)

    def publish_past(self, last: Frame | None) -> None:
        """Replace the last picture, which may still be shown, once no frame comes any more."""
        if last is None:
            return
        taken_ns, width = last.captured_ns, _WIDTH_PX
        for publisher, boxes in self._publishers:
            if publisher.has_subscribers():
                picture = past_picture(last.image, self._camera, taken_ns, width, boxes=boxes)
                self._put(publisher, picture, taken_ns)

    def _put(self, publisher: Publisher, picture: Image, captured_ns: int) -> None:
        quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        ok, data = cv2.imencode(".jpg", picture, quality)
        if ok:
            publisher.put(with_capture_time(data.tobytes(), captured_ns))
