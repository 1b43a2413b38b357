"""Training samples: a cut of a picture at the network's scale, as a bad camera gives it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from edge_daemon.frame import Image
from slipstream_lab.simulation.training.metrics import Boxes

_GREY: Final = 114
_REFERENCE_WIDTH: Final = 640
"""Width to which the daemon brings a whole picture."""
_MIN_VISIBLE: Final = 0.4
_MIN_HEIGHT_PX: Final = 6.0
_DETAIL: Final = 0.65
"""Picture px a sample px from which on a look at twice the size finds more."""


@dataclass(frozen=True)
class Sample:
    """A cut.

    Attributes:
        fine: at twice the network's size, (2 height, 2 width, 3), BGR.
        boxes: hand-made or rendered ones inside it, px of the network's size.
        detailed: whether `fine` shows more than the network's size does.
    """

    fine: Image
    boxes: Boxes
    detailed: bool


def no_boxes() -> Boxes:
    """Nothing."""
    return Boxes(np.zeros((0, 4)), np.zeros(0, dtype=np.int64), np.zeros(0))


def cut(
    image: Image,
    boxes: Boxes | None,
    shape: tuple[int, int],
    rng: np.random.Generator,
    zoom: tuple[float, float],
    stretch: float,
) -> Sample:
    """A random cut of (height, width), mirrored or not.

    Args:
        zoom: bounds of its scale; at 1 the whole picture is 640 px wide.
        stretch: its aspect changes by up to this share.
    """
    height, width = image.shape[:2]
    scale = float(np.exp(rng.uniform(np.log(zoom[0]), np.log(zoom[1]))))
    scale *= _REFERENCE_WIDTH / width
    ratio = float(np.exp(rng.uniform(-stretch, stretch)) ** 0.5)
    across, down = scale * ratio, scale / ratio
    left = _place(rng, width, shape[1] / across)
    top = _place(rng, height, shape[0] / down)
    size = 2 * shape[1], 2 * shape[0]
    if across < 0.4:
        # Linear interpolation looks at two pixels: what is shrunk further is shrunk by area first.
        image = np.asarray(
            cv2.resize(image, None, fx=2 * across, fy=2 * down, interpolation=cv2.INTER_AREA)
        )
    matrix = np.array(
        [
            [2 * across * width / image.shape[1], 0, -2 * across * left],
            [0, 2 * down * height / image.shape[0], -2 * down * top],
        ]
    )
    fine = cv2.warpAffine(
        image,
        matrix,
        size,
        flags=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=(_GREY, _GREY, _GREY),
    )
    kept = no_boxes() if boxes is None else _moved(boxes, across, down, left, top, shape)
    if rng.random() < 0.5:
        fine = fine[:, ::-1]
        flipped = kept.corners[:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [shape[1], 0, shape[1], 0]
        kept = Boxes(flipped, kept.classes, kept.scores)
    return Sample(np.ascontiguousarray(fine, dtype=np.uint8), kept, 1 / across >= _DETAIL)


def _place(rng: np.random.Generator, whole: int, part: float) -> float:
    """Where a cut begins; a picture that is smaller lies somewhere in it."""
    low, high = sorted((0.0, whole - part))
    return float(rng.uniform(low, high))


def _moved(
    boxes: Boxes, across: float, down: float, left: float, top: float, shape: tuple[int, int]
) -> Boxes:
    corners = (boxes.corners - [left, top, left, top]) * [across, down, across, down]
    inside = np.clip(corners, 0, [shape[1], shape[0]] * 2)
    area = np.prod(corners[:, 2:] - corners[:, :2], axis=1)
    seen = np.prod(inside[:, 2:] - inside[:, :2], axis=1)
    keep = (seen >= _MIN_VISIBLE * area) & (inside[:, 3] - inside[:, 1] >= _MIN_HEIGHT_PX)
    return Boxes(inside[keep], boxes.classes[keep], boxes.scores[keep])


def side_by_side(one: Sample, other: Sample, share: float) -> Sample:
    """The left part of one and the right part of another; boxes that the seam cuts are clipped."""
    width = one.fine.shape[1] // 2
    seam = round(width * share)
    fine = one.fine.copy()
    fine[:, 2 * seam :] = other.fine[:, 2 * seam :]
    parts = [
        _within(one.boxes, 0, seam),
        _within(other.boxes, seam, width),
    ]
    joined = Boxes(
        np.concatenate([p.corners for p in parts]),
        np.concatenate([p.classes for p in parts]),
        np.concatenate([p.scores for p in parts]),
    )
    return Sample(fine, joined, one.detailed and other.detailed)


def _within(boxes: Boxes, low: float, high: float) -> Boxes:
    corners = boxes.corners.copy()
    corners[:, [0, 2]] = np.clip(corners[:, [0, 2]], low, high)
    before = boxes.corners[:, 2] - boxes.corners[:, 0]
    keep = corners[:, 2] - corners[:, 0] >= _MIN_VISIBLE * before
    return Boxes(corners[keep], boxes.classes[keep], boxes.scores[keep])


def worn(image: Image, rng: np.random.Generator, strength: float = 1.0) -> Image:
    """The picture by another camera: light, colours, blur, noise, few pixels, compression."""
    out = image.astype(np.float32) / 255
    if rng.random() < 0.7 * strength:
        out = np.clip(out, 0, 1) ** float(np.exp(rng.normal(0, 0.3)))
    if rng.random() < 0.7 * strength:
        out = (out - 0.45) * float(rng.uniform(0.55, 1.35)) + 0.45 + float(rng.normal(0, 0.06))
    if rng.random() < 0.5 * strength:
        out *= rng.uniform(0.85, 1.15, 3).astype(np.float32)
    if rng.random() < 0.4 * strength:
        grey = out.mean(axis=2, keepdims=True)
        out = grey + (out - grey) * float(rng.choice([0.0, rng.uniform(0.2, 1.5)]))
    if rng.random() < 0.08 * strength:
        haze = float(rng.uniform(0.2, 0.6))
        out = out * (1 - haze) + haze * float(rng.uniform(0.5, 0.95))
    image = np.asarray(np.clip(out * 255, 0, 255), dtype=np.uint8)
    if rng.random() < 0.15 * strength:
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        hsv[..., 0] = (hsv[..., 0].astype(np.int32) + int(rng.integers(0, 180))) % 180
        image = np.asarray(cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR), dtype=np.uint8)
    if rng.random() < 0.3 * strength:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.3, 1.2))))
    if rng.random() < 0.2 * strength:
        height, width = image.shape[:2]
        share = float(rng.uniform(0.5, 0.95))
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        image = np.asarray(cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR))
    if rng.random() < 0.4 * strength:
        noise = rng.standard_normal((*image.shape[:2], 1), dtype=np.float32)
        if rng.random() < 0.5:
            noise = noise + 0.7 * rng.standard_normal(image.shape, dtype=np.float32)
        level = float(rng.uniform(1, 11))
        image = np.asarray(np.clip(image + level * noise, 0, 255), dtype=np.uint8)
    if rng.random() < 0.5 * strength:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(18, 90))]
        ok, packed = cv2.imencode(".jpg", image, quality)
        if ok:
            image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), dtype=np.uint8)
    return image


def halved(fine: Image) -> Image:
    """At the network's size."""
    size = fine.shape[1] // 2, fine.shape[0] // 2
    return np.asarray(cv2.resize(fine, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def planes(images: list[Image]) -> NDArray[np.float32]:
    """Network input (n, 3, height, width), RGB, 0..1."""
    stack = np.stack(images)[..., ::-1].transpose(0, 3, 1, 2)
    return np.ascontiguousarray(stack, dtype=np.float32) / np.float32(255)
