"""Ground truth of a clip: where each vehicle is in each frame, and how it moves."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array
from slipstream.errors import InputError

_COLUMNS: Final = (
    "frame",
    "time_s",
    "vehicle_id",
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
)


@dataclass(frozen=True)
class Truth:
    """One row a vehicle and frame, in the order of frames.

    Attributes:
        frame: number of the frame, shape (n,).
        time_s: media time, shape (n,).
        vehicle: identity, shape (n,).
        centre_m: middle of the vehicle on the road plane, m, shape (n, 2).
        speed_mps: along its lane, shape (n,).
        acceleration_mps2: along its lane, shape (n,).
        box_px: x1, y1, x2, y2, shape (n, 4).
        visible: share of it that is in the picture and not hidden, shape (n,).
        length_m: shape (n,).
    """

    frame: npt.NDArray[np.int64]
    time_s: Array
    vehicle: npt.NDArray[np.int64]
    centre_m: Array
    speed_mps: Array
    acceleration_mps2: Array
    box_px: Array
    visible: Array
    length_m: Array

    def __len__(self) -> int:
        return len(self.frame)

    def take(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> Truth:
        """Some of the rows."""
        return Truth(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def load_truth(path: Path) -> Truth:
    """Read a ``truth.csv`` as `slipstream clip` writes it; other columns are ignored.

    Raises:
        InputError: it cannot be read, a column is missing, or a value is no number.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in _COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise InputError(
                    path, "no such column", "give a truth.csv of `slipstream clip`", key=missing[0]
                )
            rows = [[row[name] for name in _COLUMNS] for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, f"cannot be read ({error})", "give a CSV file") from None
    try:
        table = np.array(rows, dtype=np.float64).reshape(-1, len(_COLUMNS))
    except (ValueError, TypeError):
        raise InputError(path, "a value is no number", "give a complete CSV file") from None
    if not np.isfinite(table).all():
        raise InputError(path, "a value is not finite", "give a complete CSV file")
    table = table[np.argsort(table[:, 0], kind="stable")]
    return Truth(
        table[:, 0].astype(np.int64),
        table[:, 1],
        table[:, 2].astype(np.int64),
        table[:, 3:5],
        table[:, 5],
        table[:, 6],
        table[:, 7:11],
        table[:, 11],
        table[:, 12],
    )
