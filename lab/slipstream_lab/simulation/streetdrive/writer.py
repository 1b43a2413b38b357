"""Writes a clip's folder: video, ground truth and calibration, which appear when complete."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2

from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive.rendering import Image

Progress = Callable[[int, int], None]
"""Called with the number of frames done and the number of frames in all."""

TRUTH_COLUMNS = (
    "frame",
    "time_s",
    "vehicle_id",
    "class",
    "x_m",
    "y_m",
    "speed_mps",
    "acceleration_mps2",
    "x1_px",
    "y1_px",
    "x2_px",
    "y2_px",
    "visible_fraction",
    "length_m",
    "width_m",
)


@dataclass(frozen=True)
class ClipSummary:
    """What was written."""

    video: Path
    truth: Path
    camera: Path
    frames: int
    vehicles: int
    truth_rows: int


def make_folder(out_dir: Path) -> None:
    """Make the folder if it is missing. Raises InputError: it cannot be made."""
    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            out_dir, f"cannot be made ({error.strerror})", "give a writable folder"
        ) from error


def write_clip(
    out_dir: Path,
    pictures: Iterable[tuple[Image, list[list[str]]]],
    camera_toml: str,
    *,
    frames: int,
    fps: float,
    size: tuple[int, int],
    progress: Progress | None = None,
) -> ClipSummary:
    """Write video.mp4 (MPEG-4 part 2), truth.csv and camera.toml into a folder.

    The files appear under their names only when complete.

    Args:
        pictures: each frame's picture with its truth rows in the order of TRUTH_COLUMNS.

    Raises:
        InputError: the folder cannot be written, or OpenCV has no MPEG-4 encoder.
    """
    video, truth, calibration = (out_dir / n for n in ("video.mp4", "truth.csv", "camera.toml"))
    part_video, part_truth = out_dir / "video.part.mp4", out_dir / "truth.part.csv"
    writer = cv2.VideoWriter(str(part_video), cv2.VideoWriter.fourcc(*"mp4v"), fps, size)
    if not writer.isOpened():
        raise InputError(
            part_video,
            "no video can be written here",
            "give a writable folder and an OpenCV with FFmpeg",
        )
    identities: set[str] = set()
    rows_written = 0
    try:
        with part_truth.open("w", newline="", encoding="ascii") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(TRUTH_COLUMNS)
            for done, (image, rows) in enumerate(pictures, start=1):
                writer.write(image)
                table.writerows(rows)
                rows_written += len(rows)
                identities.update(row[2] for row in rows)
                if progress is not None:
                    progress(done, frames)
    except BaseException:
        writer.release()
        for part in (part_video, part_truth):
            part.unlink(missing_ok=True)
        raise
    writer.release()
    calibration.write_text(camera_toml, encoding="utf-8")
    part_truth.replace(truth)
    part_video.replace(video)
    return ClipSummary(video, truth, calibration, frames, len(identities), rows_written)
