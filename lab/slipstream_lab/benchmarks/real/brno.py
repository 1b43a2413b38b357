"""Recordings of BrnoCompSpeed: passages timed by gates, and the positions that a tracker saw.

Sochor et al., Comprehensive Data Set for Automatic Single Camera Visual Speed Measurement, IEEE
T-ITS 20(5), 2019. The truth is read from its text form, ``*_truth.txt`` or ``.txt.gz``, never from
the pickles that the set comes with: those run whatever they hold.
"""

from __future__ import annotations

import ast
import gzip
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array
from slipstream.errors import InputError

SIZE: Final = (1920, 1080)
"""Of all recordings, px."""
_SUFFIXES: Final = ("_truth.txt", "_truth.txt.gz")


@dataclass(frozen=True)
class GateSurvey:
    """Distances measured on the road between points of the picture.

    Attributes:
        begin_px: shape (n, 2).
        end_px: shape (n, 2).
        distance_m: shape (n,).
        along: whether it runs along the road, else across it, shape (n,).
    """

    begin_px: Array
    end_px: Array
    distance_m: Array
    along: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Passage:
    """A vehicle's way between the gates."""

    lane: int
    end_s: float
    speed_kmh: float
    valid: bool


@dataclass(frozen=True)
class PixelTrack:
    """The positions of one vehicle's road point in the picture.

    Attributes:
        time_s: increasing, shape (n,).
        image_px: shape (n, 2).
    """

    id: int
    time_s: Array
    image_px: Array

    def __len__(self) -> int:
        return len(self.time_s)

    def take(self, rows: npt.NDArray[np.bool_] | slice) -> PixelTrack:
        """Some of the positions."""
        return PixelTrack(self.id, self.time_s[rows], self.image_px[rows])


@dataclass(frozen=True)
class GatedRecording:
    """One camera of one session.

    Attributes:
        gates: lines in the picture, the one that vehicles cross last first, shape (k, 3).
        lane_lines: that divide the lanes, lane i between i and i + 1, shape (lanes + 1, 3).
    """

    name: str
    survey: GateSurvey
    gates: Array
    lane_lines: Array
    passages: tuple[Passage, ...]
    tracks: tuple[PixelTrack, ...]

    @property
    def session(self) -> str:
        """Recordings of one session show the same vehicles."""
        return self.name.rsplit("_", 1)[0]

    def lane_of(self, image_px: Array) -> npt.NDArray[np.intp]:
        """Lane of points (n, 2) of the picture; −1 outside."""
        lines = self.lane_lines * np.sign(self.lane_lines[:, :1])
        side = np.column_stack([image_px, np.ones(len(image_px))]) @ lines.T > 0
        between = side[:, 1:] != side[:, :-1]
        return np.where(between.any(axis=1), between.argmax(axis=1), -1)


def find_recordings(folder: Path) -> list[tuple[Path, Path]]:
    """Files of truth and tracks of each recording that has both, by name."""
    found = []
    for suffix in _SUFFIXES:
        for truth in sorted(folder.glob(f"*{suffix}")):
            tracks = truth.with_name(truth.name.replace("_truth.txt", "_tracks.json"))
            if tracks.is_file():
                found.append((truth, tracks))
    return found


def load_recording(truth: Path, tracks: Path) -> GatedRecording:
    """Read a recording. Raises InputError: a file is not of the published form."""
    try:
        table = _literal(_read(truth))
        fps = float(table["fps"])
        distances = table["distanceMeasurement"]
        survey = GateSurvey(
            np.array([each["p1"][:2] for each in distances], dtype=np.float64),
            np.array([each["p2"][:2] for each in distances], dtype=np.float64),
            np.array([each["distance"] for each in distances], dtype=np.float64),
            np.array([each["toVP1"] for each in distances], dtype=np.bool_),
        )
        passages = tuple(_passage(car) for car in table["cars"])
        gates = np.array(table["measurementLines"], dtype=np.float64).reshape(-1, 3)
        lane_lines = np.array(table["laneDivLines"], dtype=np.float64).reshape(-1, 3)
    except (SyntaxError, ValueError, KeyError, TypeError, IndexError, OSError, EOFError) as error:
        raise _unreadable(truth, error) from None
    try:
        seen = json.loads(_read(tracks))
        followed = tuple(
            PixelTrack(
                int(car["id"]),
                np.array(car["frames"], dtype=np.float64) / fps,
                np.column_stack([car["posX"], car["posY"]]).astype(np.float64),
            )
            for car in seen["cars"]
            if isinstance(car["posX"], list)
        )
    except (ValueError, KeyError, TypeError, OSError, EOFError) as error:
        raise _unreadable(tracks, error) from None
    name = truth.name.split("_truth.txt")[0]
    return GatedRecording(name, survey, gates, lane_lines, passages, followed)


def _read(path: Path) -> str:
    if path.suffix == ".gz":
        with gzip.open(path, "rt", encoding="utf-8") as file:
            return file.read()
    return path.read_text(encoding="utf-8")


def _literal(text: str) -> Any:
    """Arrays and sets of numpy's and Python 2's notation, read as lists; nothing is evaluated."""
    text = re.sub(r"\barray\(", "(", text)
    return ast.literal_eval(re.sub(r"\bset\(\[(.*?)\]\)", r"[\1]", text))


def _passage(car: dict[str, Any]) -> Passage:
    (lane,) = car["laneIndex"]
    return Passage(
        int(lane),
        float(car["intersections"][-1]["videoTime"]),
        float(car["speed"]),
        bool(car["valid"]),
    )


def _unreadable(path: Path, error: Exception) -> InputError:
    problem = f"not of BrnoCompSpeed's form ({type(error).__name__}: {error})"
    return InputError(path, problem, "write the truth as text, the tracks as JSON, as published")
