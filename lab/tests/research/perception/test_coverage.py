"""The share of moving things that a detector covers, on squares that drive across a picture."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.camera import Camera, load_camera
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.detection import Detections
from edge_daemon.frame import Image
from edge_daemon.settings import DetectorSettings
from slipstream_cli.main import main
from slipstream_lab.research.perception.coverage import Coverage, measure_coverage

OPENS = "slipstream_lab.research.perception.coverage.open_detector"
SIZE = (320, 180)
NEAR, FAR = (100, 24, 0), (40, 10, 1)  # the row, the side in px, the class


def drawn(number: int) -> list[tuple[int, int, int, int]]:
    """Class and left, top, side of what is in the picture of this number; a while there is none."""
    if number < 50:
        return []
    left = 6 * number % 260 + 20
    return [(kind, left, row, side) for row, side, kind in (NEAR, FAR)]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten pictures a second for 16 s: two bright squares on grey noise, one small."""
    path = tmp_path_factory.mktemp("coverage") / "clip.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, SIZE)
    chance = np.random.default_rng(1)
    for number in range(160):
        picture = chance.integers(76, 84, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
        for _, left, top, side in drawn(number):
            picture[top : top + side, left : left + side] = 220
        writer.write(picture)
    writer.release()
    return path


class Finds:
    """A detector that finds bright squares of some sizes, with one score."""

    requests = 1

    def __init__(self, score: float, wanted: Callable[[int], bool]) -> None:
        self._score, self._wanted = score, wanted

    def detect(self, image: Image) -> Detections:
        """All of them, by their outlines."""
        bright = (image[..., 0] > 150).astype(np.uint8)
        _, _, stats, _ = cv2.connectedComponentsWithStats(bright)
        found = [row for row in stats[1:] if row[4] > 40 and self._wanted(int(row[3]))]
        boxes = np.array([[x, y, x + w, y + h] for x, y, w, h, _ in found], dtype=np.float32)
        classes = np.array([int(row[3] < 16) for row in found], dtype=np.int64)
        scores = np.full(len(found), self._score, dtype=np.float32)
        return Detections(boxes.reshape(-1, 4), scores, classes)


def measured(
    monkeypatch: pytest.MonkeyPatch, clip: Path, detector: Finds, camera: Camera | None = None
) -> Coverage:
    """What the detector covers."""
    monkeypatch.setattr(
        "slipstream_lab.research.perception.coverage.open_detector", lambda *_: detector
    )
    return measure_coverage(clip, DetectorSettings(), camera)


def test_what_is_found_is_covered(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both squares, each in its band and class; the pictures in which it learns count nothing."""
    got = measured(monkeypatch, clip, Finds(0.9, lambda _: True))
    assert got.verdict == "usable"
    assert got.share > 0.95
    assert got.unit == "px"
    near, middle, _ = got.bands
    assert near.things > 40
    assert middle.things > 40
    assert got.classes["car"] > 40
    assert got.classes["truck"] > 40


@pytest.mark.parametrize(
    ("detector", "verdict", "share", "at_all"),
    [
        (Finds(0.9, lambda _: False), "blind", 0.0, 0.0),
        (Finds(0.3, lambda _: True), "blind", 0.0, 1.0),
        (Finds(0.9, lambda side: side > 16), "doubtful", 0.5, 0.5),
    ],
)
def test_what_is_not_found_is_said(
    clip: Path,
    monkeypatch: pytest.MonkeyPatch,
    detector: Finds,
    verdict: str,
    share: float,
    at_all: float,
) -> None:
    """Nothing, nothing that starts a track, only what is near."""
    got = measured(monkeypatch, clip, detector)
    assert got.verdict == verdict
    assert got.share == pytest.approx(share, abs=0.06)
    assert sum(b.covered_at_all for b in got.bands) / got.things == pytest.approx(at_all, abs=0.06)


class FindsMore(Finds):
    """One that also finds a car on the empty ground, in each picture or in some."""

    def __init__(self, every: int) -> None:
        super().__init__(0.9, lambda _: True)
        self._every, self._number = every, 0

    def detect(self, image: Image) -> Detections:
        """What there is, and the car."""
        found, self._number = super().detect(image), self._number + 1
        if self._number % self._every:
            return found
        boxes = np.concatenate([found.boxes, np.array([[250, 130, 280, 160]], dtype=np.float32)])
        scores = np.append(found.scores, np.float32(0.9))
        return Detections(boxes, scores, np.append(found.classes, 0))


@pytest.mark.parametrize(
    ("every", "verdict", "false"),
    [(1, "usable", (0, 0)), (3, "doubtful", (10, 40)), (100, "usable", (0, 1))],
)
def test_boxes_that_come_and_go_where_nothing_moves_are_false(
    clip: Path,
    monkeypatch: pytest.MonkeyPatch,
    every: int,
    verdict: str,
    false: tuple[int, int],
) -> None:
    """A vehicle that stands is found in each picture; a bush that looks like one now and then."""
    got = measured(monkeypatch, clip, FindsMore(every))
    assert got.share > 0.95
    assert false[0] <= got.false <= false[1]
    assert (got.verdict, got.false_share > 0.01) == (verdict, verdict == "doubtful")


def test_with_a_calibration_only_the_road_counts_in_metres(
    clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The far square moves beside the watched road."""
    pixels = np.array([[0.0, 170.0], [319.0, 170.0], [0.0, 60.0], [319.0, 60.0]])
    road = np.array([[0.0, 0.0], [24.0, 0.0], [0.0, 11.0], [24.0, 11.0]])
    outline = road[[0, 1, 3, 2]]
    segment = WatchedSegment("s", outline, np.array([1.0, 0.0]), 24.0, 1, 11.0)
    got = measured(
        monkeypatch, clip, Finds(0.9, lambda _: True), Camera("c", SIZE, road, pixels, (segment,))
    )
    assert got.unit == "m"
    assert got.things > 40
    assert got.classes["truck"] == 0


def test_too_little_that_moves_proves_nothing(
    clip: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Neither way."""
    short = tmp_path / "short.mp4"
    writer = cv2.VideoWriter(str(short), cv2.VideoWriter.fourcc(*"mp4v"), 10, SIZE)
    for _ in range(30):
        writer.write(np.full((SIZE[1], SIZE[0], 3), 80, dtype=np.uint8))
    writer.release()
    got = measured(monkeypatch, short, Finds(0.9, lambda _: True))
    assert (got.verdict, got.things, got.share) == ("unsure", 0, 0.0)


def test_the_command_tells_and_its_status_too(
    clip: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As JSON and in words, the verdict last."""
    for score, status, verdict in ((0.9, 0, "usable: "), (0.3, 1, "blind: 0% of")):
        detector = Finds(score, lambda _: True)
        monkeypatch.setattr(
            "slipstream_lab.research.perception.coverage.open_detector", lambda *_, d=detector: d
        )
        assert main(["model", "check", "builtin", str(clip), "--json"]) == status
        report = json.loads(capsys.readouterr().out)
        assert verdict.startswith(report["verdict"])
        assert [band["name"] for band in report["bands"]] == ["near", "middle", "far"]
        assert main(["model", "check", "builtin", str(clip)]) == status
        assert capsys.readouterr().out.splitlines()[-1].startswith(verdict)


@pytest.mark.long
def test_the_shipped_weights_are_usable_on_renders(street_clips: dict[str, Path]) -> None:
    """By the clip's own calibration."""
    folder = street_clips["stable"]
    camera = load_camera(folder / "camera.toml")
    got = measure_coverage(folder / "video.mp4", DetectorSettings(), camera)
    assert got.verdict == "usable"
    assert got.things > 50


@pytest.mark.parametrize(
    "arguments",
    [
        ["none.xml", "{clip}"],
        ["builtin", "none.mp4"],
        ["builtin", "{clip}", "--camera", "none.toml"],
    ],
)
def test_bad_input_is_one_line(
    clip: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    """Exit status 2, and the file is named."""
    assert main(["model", "check", *(a.format(clip=clip) for a in arguments)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "none" in line
