"""`slipstream track` as a user runs it, on rendered video with the shipped detector."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from slipstream.messages import SegmentState, decode
from slipstream.service import rss_mb
from slipstream_cli.main import main


def arguments(folder: Path, *more: str | Path) -> list[str]:
    """The command line for a clip's folder."""
    return [
        "track",
        str(folder / "video.mp4"),
        "--camera",
        str(folder / "camera.toml"),
        *map(str, more),
    ]


@pytest.mark.long
def test_a_clip_is_followed_scored_and_drawn(
    street_clips: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every frame goes through; states, figures beside the truth, and the picture for people."""
    folder = street_clips["stable"]
    states, film = tmp_path / "states.jsonl", tmp_path / "drawn.mp4"
    others_mb = rss_mb()  # what the tests before left in this process
    status = main(
        arguments(
            folder, "--truth", folder / "truth.csv", "--out", states, "--annotated", film, "--json"
        )
    )
    summary = json.loads(capsys.readouterr().out)
    assert status == 0
    assert summary["frames"] == 14 * 15
    assert summary["states"] == 14
    assert 0 < summary["ms_per_frame"]["median"] <= summary["ms_per_frame"]["p95"]
    assert 50 < summary["rss_mb"] < others_mb + 700
    assert summary["speed_mae_kmh"] < 1.0
    assert summary["idf1"] > 0.95
    assert 0.5 < summary["hota"] <= 1.0
    assert summary["y_e_agreement"] == 1.0
    assert summary["features"]["mean_speed_mps"]["mean_abs_error"] < 0.3
    (counted,) = summary["counts"]
    assert counted["segment"] == "stable_road"
    assert counted["watched_s"] == pytest.approx(14.0, abs=0.3)
    vehicles, error = counted["vehicles"]
    assert vehicles == sum(counted[name][0] for name in ("car", "truck", "bus", "motorcycle"))
    assert vehicles > 0
    assert error > 0
    assert counted["flow_vph"] is None
    lines = states.read_text().splitlines()
    parsed = [decode(SegmentState, line.encode(), "states") for line in lines]
    assert [state.sequence for state in parsed] == list(range(1, 15))
    assert parsed[-1].y_e == 1
    capture = cv2.VideoCapture(str(film))
    assert int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) == 14 * 15
    assert not list(tmp_path.glob("*.part*"))
    drawn, plain = capture.read()[1], cv2.VideoCapture(str(folder / "video.mp4")).read()[1]
    assert drawn.shape == plain.shape
    assert (cv2.absdiff(drawn, plain) > 60).any()


@pytest.mark.long
def test_what_must_not_be_looked_at_is_in_no_picture(
    street_clips: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mask beside the road is grey in the film, and changes no count."""
    folder, masked = street_clips["stable"], tmp_path / "masked"
    shutil.copytree(folder, masked)
    text = (folder / "camera.toml").read_text()
    outline = "masks = [[[0, 0], [1280, 0], [1280, 60], [0, 60]]]"
    (masked / "camera.toml").write_text(f"{outline}\n{text}")
    film = tmp_path / "drawn.mp4"
    found = []
    for clip, more in ((folder, ()), (masked, ("--annotated", film))):
        states = tmp_path / f"{clip.name}.jsonl"
        assert main(arguments(clip, "--out", states, "--json", *more)) == 0
        (counted,) = json.loads(capsys.readouterr().out)["counts"]
        found.append(counted["vehicles"])
    assert found[0] == found[1]
    drawn = cv2.VideoCapture(str(film)).read()[1]
    # Beside what is written on it.
    assert np.abs(drawn[:50, 900:].astype(int) - 114).max() < 12


@pytest.fixture
def grey(tmp_path: Path) -> Path:
    """The folder of a clip of three seconds of nothing, beside the camera of the examples."""
    folder = tmp_path / "grey"
    folder.mkdir()
    shutil.copy(Path(__file__).parents[2] / "deploy/config/camera-rsu-1.toml", folder)
    (folder / "camera-rsu-1.toml").rename(folder / "camera.toml")
    _write(folder / "video.mp4", 5.0, 15, (1280, 720))
    return folder


def _write(path: Path, fps: float, frames: int, size: tuple[int, int]) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    picture = np.random.default_rng(1).integers(90, 160, (size[1], size[0], 3), dtype=np.uint8)
    for _ in range(frames):
        writer.write(picture)
    writer.release()


@pytest.mark.long
def test_a_fault_of_the_camera_is_seen_in_a_recording_too(
    street_clips: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """While the picture is dark all segments are unknown for that, and known again after it."""
    folder = street_clips["stable"]
    spoiled, states = tmp_path / "spoiled.mp4", tmp_path / "s.jsonl"
    capture = cv2.VideoCapture(str(folder / "video.mp4"))
    writer = cv2.VideoWriter(str(spoiled), cv2.VideoWriter.fourcc(*"mp4v"), 15, (1280, 720))
    for number in range(14 * 15):
        picture = capture.read()[1]
        writer.write(picture * 0 if 30 <= number < 75 else picture)
    writer.release()
    command = ["track", str(spoiled), "--camera", str(folder / "camera.toml"), "--window", "6"]
    truth = ["--truth", str(folder / "truth.csv")]
    assert main([*command, *truth, "--out", str(states), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert list(summary["fault_s"]) == ["dark"]
    assert 1.5 < summary["fault_s"]["dark"] < 6.0
    # Frames are held against the truth of their own moment, before the fault and after it.
    assert summary["idf1"] > 0.75
    assert summary["speed_mae_kmh"] < 1.0
    told = [
        decode(SegmentState, line.encode(), "states") for line in states.read_text().splitlines()
    ]
    assert "dark" in {state.reason for state in told}
    assert all(state.y_e is None for state in told if state.reason == "dark")
    assert told[-1].y_e == 1


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "problem"),
    [
        (["--truth", "none.csv"], "none.csv"),
        (["--model", "none.xml"], "none.xml"),
        (["--window", "1"], "window_s"),
        (["--every", "0"], "state_interval_s"),
        (["--config", "none.toml"], "none.toml"),
        (["--out", "/proc/none/states.jsonl"], "cannot be written"),
        (["--out", "."], "cannot be written"),
        (["--annotated", "/proc/none/film.mp4"], "no video can be written"),
    ],
)
def test_bad_input_is_one_line(
    grey: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    more: list[str],
    problem: str,
) -> None:
    """It says what is wrong, and exits with 2."""
    monkeypatch.chdir(tmp_path)
    Path("video.states.jsonl").write_text("of an earlier run")
    assert main(arguments(grey, *more)) == 2
    assert {path.name for path in tmp_path.iterdir()} == {"grey", "video.states.jsonl"}
    assert Path("video.states.jsonl").read_text() == "of an earlier run"
    captured = capsys.readouterr()
    (line,) = [text for text in captured.err.splitlines() if text.startswith("slipstream: ")]
    assert problem in line
    assert captured.out == ""


def test_a_video_of_another_size_is_one_line(
    grey: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The calibration is for another picture."""
    monkeypatch.chdir(tmp_path)
    small = tmp_path / "small.mp4"
    _write(small, 15.0, 5, (640, 360))
    camera = grey / "camera.toml"
    assert main(["track", str(small), "--camera", str(camera)]) == 2
    assert "640×360" in capsys.readouterr().err


@pytest.mark.long
def test_a_clip_without_a_rate_asks_for_it(
    grey: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A row of JPEGs says none: one line names the option, and nothing is written."""
    monkeypatch.chdir(tmp_path)
    capture = cv2.VideoCapture(str(grey / "video.mp4"))
    raw = tmp_path / "raw.mjpeg"
    raw.write_bytes(b"".join(cv2.imencode(".jpg", capture.read()[1])[1] for _ in range(5)))
    camera = grey / "camera.toml"
    assert main(["track", str(raw), "--camera", str(camera)]) == 2
    assert "--fps" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"grey", "raw.mjpeg"}
    assert main(["model", "check", "builtin", str(raw)]) == 2
    assert "--fps" in capsys.readouterr().err
    line = ["track", str(raw), "--camera", str(camera), "--fps", "15", "--json"]
    assert main([*line, "--out", str(tmp_path / "s.jsonl")]) == 0
    assert json.loads(capsys.readouterr().out)["fps_from"] == "given"


@pytest.mark.long
@pytest.mark.slow
def test_the_window_of_a_roadside_unit_is_taken(
    grey: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What its site.toml says of the window holds for its recordings too."""
    clip = grey / "video.mp4"
    config = tmp_path / "edge.toml"
    config.write_text(
        f'''
[rsus.r]
camera = "{grey / "camera.toml"}"
window_s = 4.0
source.clip = "{clip}"
'''
    )
    line = ["track", str(clip), "--camera", str(grey / "camera.toml"), "--json"]
    states = tmp_path / "s.jsonl"
    assert main([*line, "--config", str(config), "--out", str(states)]) == 0
    told = [json.loads(line)["window_s"] for line in states.read_text().splitlines()]
    assert set(told) == {4.0}
