"""The picture for people: segments in the colour of their flag, boxes and speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from edge_daemon.camera import Camera
from edge_daemon.frame import Image
from edge_daemon.tracking import Track
from slipstream.messages import SegmentState

_BGR = {1: (115, 158, 0), 0: (0, 94, 213), None: (150, 150, 150)}
_WORD = {1: "stable", 0: "turbulent", None: "unknown"}
_WHITE, _DARK = (255, 255, 255), (45, 38, 30)
_MPS_TO_KMH = 3.6
_SEEN_S = 0.1
_LABELLED_PX = 45


def annotate(
    image: Image,
    camera: Camera,
    tracks: Sequence[Track],
    states: Mapping[str, SegmentState],
    time_s: float,
    width: int,
) -> Image:
    """Draw what the pipeline knows at a media time over a copy of the picture, ``width`` px."""
    picture = image.copy()
    overlay = picture.copy()
    for segment in camera.segments:
        state = states.get(segment.id)
        colour = _BGR[state.y_e if state else None]
        outline = camera.to_image(segment.polygon_m).round().astype(np.int32)
        cv2.fillPoly(overlay, [outline], colour)
        cv2.polylines(picture, [outline], True, colour, 3, cv2.LINE_AA)
    cv2.addWeighted(overlay, 0.22, picture, 0.78, 0, dst=picture)
    for track in tracks:
        if time_s - track.last_seen_s > _SEEN_S:
            continue  # coasting: its last box is somewhere it no longer is
        x1, y1, x2, y2 = (round(float(edge)) for edge in track.box)
        cv2.rectangle(picture, (x1, y1), (x2, y2), _WHITE, 2, cv2.LINE_AA)
        if y2 - y1 >= _LABELLED_PX:
            _label(picture, f"{_MPS_TO_KMH * track.speed_mps:.0f} km/h", (x1, y1 - 8), 0.8)
    for row, segment in enumerate(camera.segments):
        state = states.get(segment.id)
        word = _WORD[state.y_e if state else None]
        if state and state.reason:
            word += f" ({state.reason.replace('_', ' ')})"
        _label(picture, f"{segment.id}: {word}", (20, 64 + 64 * row), 2.0)
    height = round(picture.shape[0] * width / picture.shape[1])
    return np.asarray(
        cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8
    )


def _label(picture: Image, text: str, at: tuple[int, int], scale: float) -> None:
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 2)
    x, y = at
    cv2.rectangle(picture, (x - 4, y - height - 6), (x + width + 4, y + below), _DARK, cv2.FILLED)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, _WHITE, 2, cv2.LINE_AA)
