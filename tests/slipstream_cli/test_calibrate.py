"""`slipstream calibrate` as a user meets it."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.camera import load_camera
from slipstream_cli.main import main
from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera

SEGMENT = """
[[segments]]
id = "approach"
polygon = [[20.0, 0.0], [70.0, 0.0], [70.0, 7.0], [20.0, 7.0]]
direction = [-1.0, 0.0]
lanes = 2
"""


@pytest.fixture
def view(tmp_path: Path) -> Path:
    """A picture, and beside it points.toml of the camera that took it."""
    camera = PinholeCamera(9.0, 8.0, 0.3, -0.2, 1000.0)
    road = np.array([(x, y, 0.0) for x in (18, 30, 45, 80) for y in (-7, 7)])
    pixels, _ = camera.project(road)
    lines = ['name = "north"']
    for (u, v), (x, y, _) in zip(pixels, road, strict=True):
        lines += ["[[points]]", f"image = [{u:.3f}, {v:.3f}]", f"road = [{x}, {y}]"]
    (tmp_path / "points.toml").write_text("\n".join(lines) + SEGMENT)
    picture = tmp_path / "view.png"
    cv2.imwrite(str(picture), np.full((720, 1280, 3), 100, dtype=np.uint8))
    return picture


def calibrate(view: Path, *more: str) -> int:
    """Run it on the picture and its points."""
    folder = view.parent
    return main(
        [
            *("calibrate", "--image", str(view), "--points", str(folder / "points.toml")),
            *("--out", str(folder / "camera.toml"), *more),
        ]
    )


def test_points_become_a_camera_and_a_grid(view: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file loads, the grid is a picture, and the report states error, pose and accuracy."""
    grid = view.with_name("grid.png")
    assert calibrate(view, "--overlay", str(grid)) == 0
    camera = load_camera(view.with_name("camera.toml"))
    assert camera.name == "north"
    assert camera.reference == view
    assert cv2.imread(str(grid)).shape == (720, 1280, 3)
    said = capsys.readouterr().out
    assert "8 points, reprojection error 0.00 px" in said
    assert "camera 9.0 m above the road at (0.0, 8.0), focal length 1000 px" in said
    assert "approach, far end: 1 px is" in said


def test_the_report_is_json_too(view: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One object; both ends of the segment; a point that was wrong is marked."""
    points = view.with_name("points.toml")
    points.write_text(points.read_text().replace("road = [45.0, 7.0]", "road = [45.0, -90.0]"))
    assert calibrate(view, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert [point["used"] for point in result["points"]] == [True] * 5 + [False] + [True] * 2
    assert [(s["id"], s["end"]) for s in result["segments"]] == [
        ("approach", "near"),
        ("approach", "far"),
    ]
    assert 0 < result["segments"][0]["speed_error"] < result["segments"][1]["speed_error"] < 0.03
    assert "point 6 " in result["warnings"][0]


def test_calibrating_again_keeps_segments_and_name(
    view: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Points alone, for a camera that was moved, leave what it watches as it was."""
    assert calibrate(view) == 0
    points = view.with_name("points.toml")
    bare = points.read_text().replace(SEGMENT, "").replace('name = "north"', "")
    points.write_text(bare)
    assert calibrate(view) == 0
    camera = load_camera(view.with_name("camera.toml"))
    assert camera.name == "north"
    assert [segment.id for segment in camera.segments] == ["approach"]
    view.with_name("camera.toml").unlink()
    assert calibrate(view) == 0
    assert "no segments yet" in capsys.readouterr().out


def test_a_video_leaves_its_first_frame_as_reference(view: Path) -> None:
    """The frame is kept beside the calibration."""
    clip = view.with_name("clip.avi")
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 10, (1280, 720))
    writer.write(np.full((720, 1280, 3), 100, dtype=np.uint8))
    writer.release()
    folder = view.parent
    options = ["--points", str(folder / "points.toml"), "--out", str(folder / "camera.toml")]
    assert main(["calibrate", "--image", str(clip), *options]) == 0
    assert load_camera(folder / "camera.toml").reference == folder / "camera-reference.png"


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("[18.0, -7.0]", "[18.0]"), "points.0.road"),
        (('name = "north"', "[image]\nwidth = 640\nheight = 360"), "is for 640×360 px"),
        (("road = ", "read = "), "unknown key"),
        (("polygon = [[20.0, 0.0]", "polygon = [[-20.0, 0.0]"), "behind the horizon"),
    ],
)
def test_bad_points_are_one_line(
    view: Path, change: tuple[str, str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It names the points file and what is wrong; nothing is written."""
    points = view.with_name("points.toml")
    points.write_text(points.read_text().replace(*change))
    assert calibrate(view) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(points) in line
    assert problem in line
    assert not view.with_name("camera.toml").exists()


@pytest.mark.parametrize("option", [["--json"], ["--overlay", "grid.png"]])
def test_the_page_takes_no_option_of_the_report(
    view: Path, option: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """It would be ignored: one line says so."""
    assert calibrate(view, "--serve", *option) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{option[0]}: is not for --serve" in line


@pytest.mark.slow
def test_bad_pictures_and_places_are_one_line(
    view: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pictures that are none or of forged size; targets that are no picture's, or the input."""
    text = view.with_name("text.png")
    text.write_text("no picture")
    huge = view.with_name("huge.png")
    header = b"IHDR" + struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
    check = struct.pack(">I", zlib.crc32(header))
    huge.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + check)
    points = view.with_name("points.toml")
    out = view.with_name("camera.toml")
    for picture, overlay, target in (
        (text, "grid.png", out),
        (view.with_name("none.png"), "grid.png", out),
        (view, "grid.txt", out),
        (view, "none/grid.png", out),
        (view, "grid.png", text),
        (view, "view.png", out),
        (view, "grid.png", view),
        (view, "camera.toml", out),
        (huge, "grid.png", out),
    ):
        arguments = ["--points", str(points), "--out", str(target)]
        overlay_path = str(view.parent / overlay)
        status = main(["calibrate", "--image", str(picture), "--overlay", overlay_path, *arguments])
        assert status == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("slipstream: ")
        assert not out.exists()
    assert text.read_text() == "no picture"
