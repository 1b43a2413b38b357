"""Decoders that keep their remarks to themselves: one clear line comes from the source instead."""

from __future__ import annotations

import os

import cv2

_SILENT = "-8"


def quieten() -> None:
    """Silence FFmpeg and OpenCV's warnings, unless the environment asks for them."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", _SILENT)
    if "OPENCV_LOG_LEVEL" not in os.environ:
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
