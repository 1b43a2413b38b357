"""The annotated frame: segments in the colour of their flag, boxes, track ids and speeds. A picture
outlives its moment: it shows when it was taken, and each flag when it held.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Final

import cv2
import numpy as np

from edge_daemon.camera import Camera
from edge_daemon.drawing import DARK, WHITE, Colour, Labels, tint
from edge_daemon.frame import Image
from edge_daemon.tracking import Track
from slipstream.messages import SegmentState

_BGR: Final[dict[int | None, Colour]] = {
    1: (115, 158, 0),
    0: (0, 94, 213),
    None: (170, 170, 170),
}
_WORD: Final = {1: "stable", 0: "turbulent", None: "unknown"}
_MPS_TO_KMH: Final = 3.6
_SEEN_S: Final = 0.1
_KNOWN_AFTER_S: Final = 0.5
"""Before, a track's speed is still largely what a new track starts with."""
_MIN_FONT_SCALE: Final = 0.38
_LABELLED_OF_FONT: Final = 50  # px of box a unit of font scale
_TINT: Final = 0.22
_SMALLER: Final = (1.0, 0.75, 0.5)
_PAST: Final = 0.5


def utc_date_and_time(time_ns: int) -> str:
    """A moment as a picture shows it."""
    return f"{datetime.fromtimestamp(time_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC"


def utc_time(time_ns: int) -> str:
    """A moment of the picture's day."""
    return f"{datetime.fromtimestamp(time_ns // 10**9, UTC):%H:%M:%S} UTC"


def draw_time(picture: Image, text: str) -> None:
    """Draw when a picture was taken into its lower left corner."""
    height, width = picture.shape[:2]
    labels = Labels(picture)
    _put(labels, text, (0.015 * width, height - 0.02 * width), height / 640)
    labels.draw()


def past_picture(image: Image, camera: Camera, taken_ns: int, width: int, *, boxes: bool) -> Image:
    """The last frame of a camera that sends none, without colour; its segments, if drawn, are
    unknown.
    """
    grey = cv2.cvtColor(scaled(image, width), cv2.COLOR_BGR2GRAY)
    past = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR) * _PAST, np.uint8)
    picture = annotate(past, camera, (), {}, 0.0, width) if boxes else past
    draw_time(picture, f"no picture since {utc_date_and_time(taken_ns)}")
    return picture


def scaled(image: Image, width: int) -> Image:
    """A copy of the frame, ``width`` px wide."""
    zoom = width / image.shape[1]
    if zoom == 1:
        return image.copy()
    size = width, round(image.shape[0] * zoom)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def annotate(
    image: Image,
    camera: Camera,
    tracks: Sequence[Track],
    states: Mapping[str, SegmentState],
    time_s: float,
    width: int,
    clock: Callable[[int], str] = utc_time,
) -> Image:
    """Draw what the pipeline knows at a media time over a copy of the frame, ``width`` px wide.

    Beside each flag stands the end of its window, as ``clock`` writes it. Vehicles seen just now
    have boxes and, where there is room, numbers, nearer ones first; speeds are shown inside
    segments only, as the calibration is not checked elsewhere, and after half a second.
    """
    zoom = width / camera.size[0]
    picture = scaled(image, width)
    height = len(picture)
    stroke = max(1, round(height / 360))
    labels = Labels(picture)
    for row, segment in enumerate(camera.segments):
        state = states.get(segment.id)
        colour = _BGR[state.y_e if state else None]
        outline = zoom * camera.outline_px(segment)
        tint(picture, outline, colour, _TINT)
        corners = outline.round().astype(np.int32)
        cv2.polylines(picture, [corners], True, colour, stroke + 1, cv2.LINE_AA)
        scale = height / 640
        _put(
            labels,
            f"{segment.id}: {_verdict(state, clock)}",
            (0.015 * width, 45 * scale * (row + 1)),
            scale,
            colour,
        )
    # A track that coasts is not shown: its last box is somewhere it no longer is.
    shown = [track for track in tracks if time_s - track.last_seen_s <= _SEEN_S]
    shown.sort(key=lambda track: -float(track.box[3]))
    boxes = [[round(zoom * float(edge)) for edge in track.box] for track in shown]
    for x1, y1, x2, y2 in boxes:
        cv2.rectangle(picture, (x1, y1), (x2, y2), WHITE, stroke, cv2.LINE_AA)
    scale = max(_MIN_FONT_SCALE, height / 1400)
    watched = _watched(camera, shown)
    for track, inside, (x1, y1, x2, y2) in zip(shown, watched, boxes, strict=True):
        if y2 - y1 >= _LABELLED_OF_FONT * scale:
            known = inside and track.last_seen_s - track.first_seen_s >= _KNOWN_AFTER_S
            speed = f"  {_MPS_TO_KMH * track.speed_mps:.0f} km/h" if known else ""
            labels.put(
                f"#{track.id}{speed}",
                [(x1, y1 - 12 * scale), (x1, y2 + 32 * scale), (x2, y1), (x2, y2)],
                scale,
            )
    labels.draw()
    return picture


def _watched(camera: Camera, tracks: Sequence[Track]) -> list[bool]:
    """Which vehicles are in a segment."""
    if not tracks:
        return []
    places = np.stack([track.state[:2] for track in tracks])
    inside = np.any([s.contains(places) for s in camera.segments], axis=0)
    return [bool(one) for one in inside]


def _put(
    labels: Labels, text: str, place: tuple[float, float], scale: float, background: Colour = DARK
) -> None:
    """Place a label that must not be left out: smaller where it is too wide."""
    any(labels.put(text, [place], scale * share, background=background) for share in _SMALLER)


def _verdict(state: SegmentState | None, clock: Callable[[int], str]) -> str:
    if state is None:
        return _WORD[None]
    why = f" ({state.reason.replace('_', ' ')})" if state.reason else ""
    return f"{_WORD[state.y_e]}{why}, {clock(state.time_ns)}"
