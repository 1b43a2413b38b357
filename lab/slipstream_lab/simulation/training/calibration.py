"""Calibration pictures of INT8, letterboxed into the network's input as on an RSU."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from edge_daemon.camera import load_camera
from edge_daemon.detection.placement import Placement, place_dynamic
from edge_daemon.detection.region import Region, road_region
from edge_daemon.frame import Image, read_image
from slipstream.errors import InputError
from slipstream_lab.simulation.training.validation import fill

_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})
_GREY = 114


def calibration_inputs(
    source: Path, shape: tuple[int, int], count: int, camera: Path | None = None, seed: int = 1
) -> list[Image]:
    """Inputs (height, width, 3), BGR, from a clip's frames or a folder's pictures.

    Args:
        source: a video file, or a folder with pictures (also in folders below).
        shape: (height, width) at which the model was trained: it fixes the scale.
        camera: the clip's calibration: only the road's part is taken, as the daemon would. Without
            it, a camera.toml beside the clip is used if there is one.

    Raises:
        InputError: nothing in the source can be read, or it does not fit the camera.
    """
    if source.is_dir():
        return _from_folder(source, shape, count, seed)
    if camera is None and (source.parent / "camera.toml").is_file():
        camera = source.parent / "camera.toml"
    return _from_clip(source, shape, count, camera)


def _from_folder(folder: Path, shape: tuple[int, int], count: int, seed: int) -> list[Image]:
    paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in _SUFFIXES)
    if not paths:
        raise InputError(folder, "no pictures in it", "give a folder of pictures, or a clip")
    order = np.random.default_rng(seed).permutation(len(paths))[:count]
    inputs = []
    for index in order:
        image = read_image(paths[index])
        if image is None:
            raise InputError(paths[index], "not a readable picture", "remove it")
        size = image.shape[1], image.shape[0]
        inputs.append(_letterboxed(image, _placement(size, Region(0, 0, *size), shape)))
    return inputs


def _from_clip(clip: Path, shape: tuple[int, int], count: int, camera: Path | None) -> list[Image]:
    if not clip.is_file():
        raise InputError(clip, "no such clip or folder", "check the path")
    every = max(1, _frames_in(clip) // count)
    capture = cv2.VideoCapture(str(clip), cv2.CAP_FFMPEG)
    try:
        inputs: list[Image] = []
        placement = None
        number = 0
        while len(inputs) < count and capture.grab():
            if number % every == 0:
                ok, image = capture.retrieve()
                if not ok:
                    break
                if placement is None:
                    size = image.shape[1], image.shape[0]
                    placement = _placement(size, _road(size, camera, clip), shape)
                inputs.append(_letterboxed(image, placement))
            number += 1
    finally:
        capture.release()
    if not inputs:
        raise InputError(clip, "not a readable video", "record or copy it again")
    return inputs


def _frames_in(clip: Path) -> int:
    """Counted: what a container says includes the time before its first frame."""
    capture = cv2.VideoCapture(str(clip), cv2.CAP_FFMPEG)
    try:
        count = 0
        while capture.grab():
            count += 1
        return count
    finally:
        capture.release()


def _road(size: tuple[int, int], path: Path | None, clip: Path) -> Region:
    whole = Region(0, 0, *size)
    if path is None:
        return whole
    camera = load_camera(path)
    if camera.size != size:
        raise InputError(
            clip,
            f"its pictures are {size[0]}×{size[1]} px, {path} is for "
            f"{camera.size[0]}×{camera.size[1]}",
            "give its own camera.toml",
        )
    return road_region(camera) or whole


def _placement(size: tuple[int, int], wanted: Region, shape: tuple[int, int]) -> Placement:
    return place_dynamic(size, wanted, min(shape[1] / size[0], shape[0] / size[1]))


def _letterboxed(image: cv2.typing.MatLike, placement: Placement) -> Image:
    canvas = np.full((*placement.shape, 3), _GREY, dtype=np.uint8)
    fill(canvas, np.asarray(image, dtype=np.uint8), placement)
    return canvas
