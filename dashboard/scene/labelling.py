"""Which labels a browser shows: those that fit beside each other on its canvas; pure."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import numpy as np

from dashboard.scene.geometry import Array
from dashboard.scene.marks import IMPORTANCE, Eye, Mark

MAX_LABELS: Final = 40
MAX_CANDIDATES: Final = 500
"""Marks that are tried, the most important and nearest first."""
HEIGHT_PX: Final = 18.0
"""Of a label with its background: a line of 12 px and viser's padding."""
_GAP_PX: Final = 5.0
_PADDING_PX: Final = 6.0
_EM_PX: Final = 12.0
_NARROW: Final = frozenset("iljtfrI.,:;'|!()[] -/")
_WIDE: Final = frozenset("mwMW@%✓✕…+")


def width_px(text: str) -> float:
    """Width of a label, px; at least that of the fonts that viser's page uses."""
    ems = sum(
        0.42 if sign in _NARROW else 1.0 if sign in _WIDE or ord(sign) > 0x2FF else 0.72
        for sign in text
    )
    return ems * _EM_PX + _PADDING_PX


def rectangles(eye: Eye, marks: Sequence[Mark]) -> Array:
    """Where the marks' labels would be drawn: (N, 4), left, top, right, bottom, px.

    A label stands in the middle above its mark. Those behind the camera are nowhere (NaN).
    """
    pixels, depth = eye.pixels(np.array([mark.position for mark in marks]).reshape(-1, 3))
    half = np.array([width_px(mark.text) for mark in marks]) / 2
    x, y = pixels.T
    boxes = np.column_stack((x - half, y - HEIGHT_PX, x + half, y))
    boxes[depth <= 0] = np.nan
    return boxes


def fitting(
    eye: Eye, marks: Sequence[Mark], first: Mark | None = None, kept: Collection[object] = ()
) -> list[Mark]:
    """The marks whose labels are shown: none overlaps another or leaves the canvas.

    Args:
        kept: (kind, id) of those labelled until now, preferred among equals, so that labels do not
            jump from one vehicle to the next.
    """
    if not marks:
        return []
    boxes = rectangles(eye, marks)
    inside = np.flatnonzero(
        (boxes[:, 0] >= 0)
        & (boxes[:, 1] >= 0)
        & (boxes[:, 2] <= eye.width_px)
        & (boxes[:, 3] <= eye.height_px)
    )
    away = np.linalg.norm(np.array([mark.position for mark in marks]) - eye.position, axis=1)

    def rank(index: int) -> tuple[bool, bool, int, bool, float]:
        mark = marks[index]
        selected = first is not None and (mark.kind, mark.id) == (first.kind, first.id)
        shown = (mark.kind, mark.id) in kept
        return not selected, not mark.urgent, IMPORTANCE[mark.kind], not shown, float(away[index])

    chosen: list[int] = []
    taken = np.empty((MAX_LABELS, 4))
    for index in sorted(inside.tolist(), key=rank)[:MAX_CANDIDATES]:
        left, top, right, bottom = boxes[index]
        there = taken[: len(chosen)]
        clear = (
            (left > there[:, 2] + _GAP_PX)
            | (right < there[:, 0] - _GAP_PX)
            | (top > there[:, 3] + _GAP_PX)
            | (bottom < there[:, 1] - _GAP_PX)
        )
        if clear.all():
            taken[len(chosen)] = boxes[index]
            chosen.append(index)
            if len(chosen) == MAX_LABELS:
                break
    return [marks[index] for index in chosen]
