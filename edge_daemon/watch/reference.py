"""The image that a camera was calibrated on."""

from __future__ import annotations

from edge_daemon.camera import Camera, hide
from edge_daemon.frame import Image, read_image
from slipstream.errors import InputError


def read_reference(camera: Camera) -> Image | None:
    """Read it, BGR; None where the calibration names none."""
    path = camera.reference
    if path is None:
        return None
    mend = "save the picture that the calibration was made on"
    picture = read_image(path)
    if picture is None:
        raise InputError(path, "not a picture that can be read", mend)
    height, width = picture.shape[:2]
    if (width, height) != camera.size:
        raise InputError(
            path,
            f"the picture is {width}×{height}, the calibration is for "
            f"{camera.size[0]}×{camera.size[1]}",
            mend,
        )
    hide(picture, camera.masks)
    return picture
