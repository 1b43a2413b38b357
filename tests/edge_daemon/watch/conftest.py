"""Fixtures of the watch's tests."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.camera import load_camera

from .roads import Road


@pytest.fixture(scope="module")
def road(street_clips: dict[str, Path]) -> Road:
    """The road of the calm clip."""
    folder = street_clips["stable"]
    capture = cv2.VideoCapture(str(folder / "video.mp4"))
    pictures = [capture.read()[1] for _ in range(200)][::18]
    chance = np.random.default_rng(3)
    noise = tuple(chance.normal(0, 2, (720, 1280, 3)).round().astype(np.int16) for _ in range(3))
    return Road(
        np.median(np.stack(pictures), axis=0).astype(np.uint8),
        load_camera(folder / "camera.toml"),
        noise,
    )
