"""The files of a calibration: points and image in, camera.toml out."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import tomli_w

from edge_daemon.calibration.calibration import Calibration
from edge_daemon.frame import MAX_PIXELS, Image, read_image
from edge_daemon.settings import Masks, PointsSettings, SegmentSettings
from edge_daemon.sources.clip_file import first_frame
from slipstream.config import MAX_TOML_BYTES, check, load
from slipstream.errors import InputError
from slipstream.files import ending_of, read_text

_COLUMNS: Final = ("u", "v", "x", "y")


def read_points(path: Path) -> PointsSettings:
    """Read a points file: TOML, or CSV with the columns u, v (px), x, y (m)."""
    return _read_csv(path) if ending_of(path) == ".csv" else load(path, PointsSettings)


def _read_csv(path: Path) -> PointsSettings:
    text = read_text(path, MAX_TOML_BYTES)
    try:
        rows = list(csv.DictReader(io.StringIO(text, newline="")))
    except csv.Error as error:
        raise InputError(path, f"not readable: {error}", "check the file") from None
    points = []
    for line, row in enumerate(rows, start=2):
        try:
            u, v, x, y = (float(row[column]) for column in _COLUMNS)
        except (KeyError, TypeError, ValueError):
            raise InputError(
                path, "not four numbers", "give the columns u,v,x,y", key=f"line {line}"
            ) from None
        points.append({"image": [u, v], "road": [x, y]})
    return check({"points": points}, PointsSettings, path)


def read_picture(path: Path) -> tuple[Image, bool]:
    """An image, or the first readable frame of a video, and whether it was a video."""
    if not path.is_file():
        raise InputError(path, "no such picture or video", "check the path")
    picture = read_image(path)
    if picture is not None:
        return picture, False
    # FFmpeg would read pictures too, however large.
    frame = None if cv2.haveImageReader(str(path)) else first_frame(path)
    if frame is None:
        raise InputError(
            path,
            f"neither a picture nor a readable video of at most {MAX_PIXELS / 1e6:.0f} megapixels",
            "give a PNG, JPEG or clip",
        )
    return frame, True


def camera_toml(
    name: str,
    calibration: Calibration,
    segments: tuple[SegmentSettings, ...],
    reference: str,
    masks: Masks = (),
) -> str:
    """Text of the camera.toml: the points that the fit rests on, the rest as it was."""
    width, height = calibration.size
    terms = {"terms": list(calibration.terms)} if calibration.terms else {}
    lines = [
        "schema = 1",
        *tomli_w.dumps({"name": name, "reference": reference}).splitlines(),
        *(f"{key} = {json.dumps(value)}" for key, value in terms.items()),
        *([f"masks = [{', '.join(map(_outline, masks))}]"] if masks else []),
        "",
        "[image]",
        f"width = {width}",
        f"height = {height}",
    ]
    for i in np.flatnonzero(calibration.used):
        lines += [
            "",
            "[[points]]",
            f"image = {_pair(calibration.image_px[i])}",
            f"road = {_pair(calibration.road_m[i])}",
        ]
    for line in calibration.lines:
        lines += ["", "[[lines]]", f"offset = {line.offset!r}", f"image = {_outline(line.image)}"]
    for segment in segments:
        lines += [
            "",
            "[[segments]]",
            *tomli_w.dumps({"id": segment.id}).splitlines(),
            f"polygon = {_outline(segment.polygon)}",
            f"direction = {_pair(segment.direction)}",
            f"lanes = {segment.lanes}",
            f"lane_width_m = {segment.lane_width_m!r}",
        ]
    return "\n".join(lines) + "\n"


def _outline(places: Sequence[tuple[float, float]]) -> str:
    return f"[{', '.join(map(_pair, places))}]"


def _pair(pair: tuple[float, float] | np.ndarray) -> str:
    return f"[{float(pair[0])!r}, {float(pair[1])!r}]"


def reference_of(picture: Path, out: Path) -> str:
    """The image's path as a camera.toml at ``out`` names it."""
    return Path(os.path.relpath(picture.resolve(), out.resolve().parent)).as_posix()


def write_picture(path: Path, picture: Image) -> None:
    """Write a PNG or JPEG, by the name's ending."""
    try:
        ok, data = cv2.imencode(path.suffix or ".", picture)
    except cv2.error:
        ok = False
    if not ok:
        raise InputError(path, "not a picture's name", "end it in .png or .jpg")
    write_whole(path, data.tobytes())


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that appears under its name only when complete."""
    part = path.with_name(f".{path.name}.part")
    try:
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise InputError(
            path, f"cannot be written ({error.strerror})", "give a writable place"
        ) from None
