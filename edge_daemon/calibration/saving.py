"""From a points file's content to a written camera.toml: the same way for command line and page."""

from __future__ import annotations

from pathlib import Path

from edge_daemon.calibration.calibration import Calibration, calibrate
from edge_daemon.calibration.files import (
    camera_toml,
    read_points,
    reference_of,
    write_picture,
    write_whole,
)
from edge_daemon.calibration.overlay import draw_grid
from edge_daemon.camera import hide
from edge_daemon.camera.checks import check_masks, outline_px
from edge_daemon.frame import Image
from edge_daemon.settings import PointsSettings
from slipstream.errors import InputError


def check_size(
    given: PointsSettings, size: tuple[int, int], source: Path, picture_file: Path | None
) -> None:
    """Refuse points that are for a picture of another size than (width, height), px."""
    if given.image is not None and size != (given.image.width, given.image.height):
        raise InputError(
            source,
            f"is for {given.image.width}×{given.image.height} px, "
            f"{picture_file or 'the picture'} has {size[0]}×{size[1]}",
            "take the points in the picture that is given",
            key="image",
        )


def save(
    given: PointsSettings,
    source: Path,
    picture: Image,
    picture_file: Path | None,
    out: Path,
    *,
    name: str | None = None,
    overlay: Path | None = None,
    keeps_segments: bool = True,
) -> Calibration:
    """Calibrate and write the camera.toml, its reference picture and the overlay.

    Args:
        given: the points and what else is known.
        source: where they come from, for error lines.
        picture_file: where the picture lies; None writes it beside ``out``.
        out: the camera.toml.
        name: the camera's; default: the one given, that of the file before, or of ``out``.
        overlay: a picture to write the grid to.
        keeps_segments: those of the file before stay where none are given.

    Raises:
        InputError: the points are for another picture, or fix no camera; a file cannot be written.
    """
    size = (picture.shape[1], picture.shape[0])
    check_size(given, size, source, picture_file)
    before = read_points(out) if out.exists() else None
    # A camera that is calibrated anew keeps what it watches, and what it must not look at.
    kept = before.segments if before and keeps_segments else ()
    segments = given.segments or kept
    masks = given.masks or (before.masks if before else ())
    calibration = calibrate(given.points, segments, size, source, given.lines, given.terms)
    outlines = [outline_px(one.polygon_m, calibration.projection) for one in calibration.segments]
    picture = picture.copy()
    hide(picture, check_masks(masks, outlines, size, source))
    shown = name or given.name or (before.name if before else None) or out.stem
    reference = picture_file or out.with_name(f"{out.stem}-reference.png")
    if picture_file is None:
        write_picture(reference, picture)
    if overlay is not None:
        write_picture(overlay, draw_grid(picture, calibration))
    text = camera_toml(shown, calibration, segments, reference_of(reference, out), masks)
    write_whole(out, text.encode())
    return calibration
