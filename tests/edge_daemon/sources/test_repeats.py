"""Frames that show the one before once more."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.frame import Frame, Image
from edge_daemon.sources import mark_repeats
from edge_daemon.sources.clip import FastClip, open_clip

FPS = 30
SIZE = (320, 480)
SCENE = cv2.GaussianBlur(
    np.random.default_rng(7).integers(60, 180, (*SIZE, 3)).astype(np.int16), (0, 0), 3
)
GRAINS = np.random.default_rng(8).normal(0, 1, (50, *SIZE, 1))


def road(number: int, *, noise: float = 2.0, speed_px: int = 9, cars: int = 6) -> Image:
    """A textured scene with cars that move a little every frame, under sensor noise."""
    image = SCENE.copy()
    for car in range(cars):
        left = (100 * car + speed_px * number) % (SIZE[1] - 60)
        image[30 + 45 * car : 60 + 45 * car, left : left + 60] = (200, 40, 30 * car)
    if noise:
        image = image + (noise * GRAINS[number % len(GRAINS)]).round().astype(np.int16)
    return np.clip(image, 0, 255).astype(np.uint8)


def marks(images: list[Image], fps: float = FPS, cut_at: int | None = None) -> list[bool]:
    """Which of the frames are marked."""
    frames = [Frame(image, n / fps, n, n / fps, cut=n == cut_at) for n, image in enumerate(images)]
    marked = [frame.repeated for frame in mark_repeats(iter(frames)) if frame is not None]
    assert len(marked) == len(images)
    return marked


@pytest.mark.slow
@pytest.mark.parametrize(
    ("codec", "pattern"),
    [("mp4v", [2]), ("MJPG", [1, 1, 1, 2]), ("mp4v", [6]), ("MJPG", [1, 2, 1, 3, 2])],
)
def test_repeats_are_found_however_they_come_and_no_new_frame_is_lost(
    tmp_path: Path, pattern: list[int], codec: str
) -> None:
    """Every second one, a pulldown, six of a kind, uneven: encoded again. A repeat that falls on
    a key frame may pass for new: a twelfth of all.
    """
    path = tmp_path / ("clip.mp4" if codec == "mp4v" else "clip.avi")
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), FPS, SIZE[::-1])
    repeats = []
    for number in range(60):
        for again in range(pattern[number % len(pattern)]):
            writer.write(road(number))
            repeats.append(again > 0)
    writer.release()
    source = FastClip(open_clip(path, loop=False))
    marked = [frame.repeated for frame in mark_repeats(source.frames()) if frame is not None]
    learned = 2 * sum(pattern) + 10
    pairs = list(zip(marked, repeats, strict=True))[learned:]
    assert not any(mark and not repeat for mark, repeat in pairs)
    found = sum(mark and repeat for mark, repeat in pairs)
    assert found >= 0.85 * sum(repeat for _, repeat in pairs)


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("cars", [0, 1, 6])
def test_a_camera_that_repeats_nothing_loses_no_frame_while_vehicles_move(
    noise: float, cars: int
) -> None:
    """With a sensor's noise or without any, with many vehicles, one, or none."""
    marked = marks([road(n, noise=noise, cars=cars) for n in range(90)])
    if cars or noise:
        assert not any(marked)
    else:  # exact copies: whatever they are, one in 0.45 s counts as new
        assert sum(not one for one in marked) >= 90 / FPS / 0.45


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_car_that_comes_after_busy_traffic_is_not_taken_for_a_repeat(noise: float) -> None:
    """Much less changes than a moment before, but something moves."""
    busy = [road(n, noise=noise) for n in range(90)]
    marked = marks([*busy, *(road(n, noise=noise, cars=1) for n in range(90, 150))])
    assert not any(marked)


@pytest.mark.parametrize("fps", [4, 5, 12.5, 60])
def test_the_window_stays_covered_at_any_rate(fps: float) -> None:
    """The pipeline takes a gap of more than 0.5 s between frames for a hole."""
    moving = [road(n) for n in range(20)]
    marked = marks([*moving, *([moving[-1]] * 15)], fps)
    new = [n / fps for n, repeated in enumerate(marked) if not repeated]
    assert max(np.diff(new)) <= 0.45 + 1e-9
    assert any(marked) == (fps > 4)


def test_traffic_that_stands_is_looked_at_twice_a_second() -> None:
    """Exact copies after traffic that moved: one in 0.45 s at least counts as new."""
    images = [road(n) for n in range(60)] + [road(59)] * 90
    marked = marks(images)
    new = [n / FPS for n, repeated in enumerate(marked) if not repeated and n >= 60]
    assert new[0] - 59 / FPS == pytest.approx(0.43, abs=0.02)
    assert np.diff(new).max() <= 0.45


def test_the_first_frame_of_another_scene_is_new() -> None:
    """A loop that begins with the frame that it ended with."""
    images = [road(n) for n in range(40)]
    images[30] = images[29]
    assert marks(images)[30]
    assert not marks(images, cut_at=30)[30]


def test_what_has_not_come_is_handed_on() -> None:
    """A source's None, while it has no frame, stays None."""
    assert list(mark_repeats(iter([None, None]))) == [None, None]
