"""Template tiles of a frame, and how far each has shifted in later frames.

Tiles are compared by normalised correlation of what differs from their surroundings, so that
light and contrast may change; the peak is placed to a fraction of a pixel by parabolas.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from edge_daemon.camera import Array
from edge_daemon.watch.sample import Floats, Mask

HALF_PX: Final = 10
REACH_PX: Final = 8
_MARGIN = HALF_PX + REACH_PX
_MAX_TILES = 24
_FOUND = 0.6
_UNIQUE = 0.8
_MIN_CORNER = 4.0
_NEAR_PX = 3


@dataclass(frozen=True)
class Tiles:
    """Pieces of one frame's `texture`, (2·HALF_PX+1)² each, around centres (column, row), px, shape
    (n, 2).
    """

    centres: npt.NDArray[np.int64]
    pieces: tuple[Floats, ...]

    def __len__(self) -> int:
        return len(self.pieces)

    def shifts(self, picture: Floats) -> Array:
        """How far each piece has moved in a frame's `texture`, px, (n, 2); NaN: not found."""
        found = np.full((len(self), 2), np.nan)
        for index, (piece, (u, v)) in enumerate(zip(self.pieces, self.centres, strict=True)):
            around = _cut(picture, int(u), int(v), _MARGIN)
            match = cv2.matchTemplate(around, piece, cv2.TM_CCOEFF_NORMED)
            _, score, _, (column, row) = cv2.minMaxLoc(match)
            if score >= _FOUND:
                found[index] = _peak(np.asarray(match, dtype=np.float64), column, row)
        return found


def choose_tiles(picture: Floats, allowed: Mask) -> Tiles:
    """Pick pieces of a `texture` with corners in them, far apart, that resemble nothing nearby and
    have allowed centres.
    """
    corners = cv2.cornerMinEigenVal(picture, 2 * HALF_PX + 1)
    inside = np.zeros_like(allowed)
    inside[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN] = True
    corners[~(allowed & inside)] = 0.0
    centres: list[tuple[int, int]] = []
    pieces: list[Floats] = []
    while len(pieces) < _MAX_TILES:
        _, best, _, (u, v) = cv2.minMaxLoc(corners)
        if best * _PIXELS < _MIN_CORNER:
            break
        cv2.circle(corners, (u, v), 2 * HALF_PX, (0.0,), cv2.FILLED)
        piece = _cut(picture, u, v, HALF_PX)
        if _is_unique(picture, u, v, piece):
            centres.append((u, v))
            pieces.append(piece)
    return Tiles(np.array(centres, dtype=np.int64).reshape(-1, 2), tuple(pieces))


_PIXELS = (2 * HALF_PX + 1) ** 2


def _cut(picture: Floats, u: int, v: int, half: int) -> Floats:
    return np.ascontiguousarray(picture[v - half : v + half + 1, u - half : u + half + 1])


def _is_unique(picture: Floats, u: int, v: int, piece: Floats) -> bool:
    match = np.asarray(
        cv2.matchTemplate(_cut(picture, u, v, _MARGIN), piece, cv2.TM_CCOEFF_NORMED)
    ).copy()
    middle = slice(REACH_PX - _NEAR_PX, REACH_PX + _NEAR_PX + 1)
    match[middle, middle] = -1.0
    return float(match.max()) < _UNIQUE


def _peak(match: Array, column: int, row: int) -> tuple[float, float]:
    return (
        column + _vertex(match[row], column) - REACH_PX,
        row + _vertex(match[:, column], row) - REACH_PX,
    )


def _vertex(values: Array, at: int) -> float:
    """Where the parabola through a maximum and its neighbours peaks, from -0.5 to 0.5."""
    if not 0 < at < len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1 : at + 2]
    curve = left - 2 * middle + right
    return float((left - right) / (2 * curve)) if curve < 0 else 0.0
