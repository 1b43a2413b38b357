"""The protocol of detectors, their detections and vehicle classes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from edge_daemon.frame import Image
from slipstream.errors import InputError

VEHICLE_CLASSES: Final = ("car", "truck", "bus", "motorcycle")
MIN_SCORE: Final = 0.1
"""Detections with a lower score are dropped; the tracker has its own threshold."""
NMS_IOU: Final = 0.45
"""Intersection over union with a better box, above which a box is suppressed."""


@dataclass(frozen=True)
class Detections:
    """Vehicles found in one frame: boxes x1, y1, x2, y2 in px of the frame (n, 4), scores in (0,
    1], and classes, indices into VEHICLE_CLASSES.
    """

    boxes: npt.NDArray[np.float32]
    scores: npt.NDArray[np.float32]
    classes: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.scores)

    def boxes_above(self, score: float) -> npt.NDArray[np.float32]:
        """Boxes of the detections with this score at least, shape (n, 4)."""
        return self.boxes[self.scores >= score]


def box_feet(boxes: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """The middle of each box's (n, 4) lower edge, px, shape (n, 2): where it stands on the road."""
    return np.column_stack([(boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3]]).astype(np.float64)


class Detector(Protocol):
    """Finds vehicles in a frame."""

    @property
    def requests(self) -> int:
        """Frames that it takes at a time; `detect` may be called from so many threads."""
        ...

    def detect(self, image: Image) -> Detections:
        """Vehicles in a BGR frame (height, width, 3)."""
        ...


def vehicle_class_of(names: list[str], source: str | Path) -> npt.NDArray[np.int64]:
    """Map a model's classes to VEHICLE_CLASSES, what is no vehicle to −1; InputError if all are."""
    mapping = np.array(
        [VEHICLE_CLASSES.index(name) if name in VEHICLE_CLASSES else -1 for name in names],
        dtype=np.int64,
    )
    if (mapping < 0).all():
        raise InputError(
            source,
            f"none of its {len(names)} classes is a vehicle",
            f"give a model with {', '.join(VEHICLE_CLASSES)}",
        )
    return mapping
