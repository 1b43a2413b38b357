"""What training scenes are drawn from: a wide range to learn shapes, and the roadside's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import CLEAR, Conditions

Span = tuple[float, float]


@dataclass(frozen=True)
class SceneRange:
    """Bounds of what is drawn for each picture; spans are uniform unless said otherwise.

    `label_end` bounds the end of traffic as a multiple of the distance at which a car of 1.5 m
    falls under the label's least height; with `far_share` it lies within `far_m` instead.
    `gaps_m` are mean gaps of a lane, drawn by `gap_shares`; `shape_weights` are Dirichlet weights
    of the shapes in the order of CLASS_OF_SHAPE; `shots` pictures share one stage and camera.
    `conditions` are the kinds of weather, hour and camera state that a stage is drawn from (see
    `draw_conditions`); `variety` draws vehicles and surroundings from `variety.py` (training only).
    """

    name: str
    shots: int
    height_m: Span
    focal_px: Span
    horizon_px: Span
    target_m: Span
    roll_deg: float
    gaps_m: tuple[float, ...]
    gap_shares: tuple[float, ...]
    shape_weights: tuple[float, ...]
    label_end: Span
    far_share: float
    far_m: Span
    distractors: float
    cover_share: float
    blur_px: Span
    vignette: Span
    noise_levels: Span
    contrast: Span
    brightness: float
    gamma: Span
    cast: Span
    grey_share: float
    jpeg_quality: tuple[int, int]
    conditions: tuple[str, ...] = ()
    variety: bool = False


WIDE = SceneRange(
    name="wide",
    shots=1,
    height_m=(6.0, 14.0),
    focal_px=(780.0, 1420.0),
    horizon_px=(-60.0, 190.0),
    target_m=(28.0, 75.0),
    roll_deg=1.2,
    gaps_m=(3.0, 9.0, 18.0, 40.0),
    gap_shares=(0.2, 0.3, 0.3, 0.2),
    shape_weights=(5.0, 5.0, 4.5, 3.5, 2.8, 2.2, 3.0, 3.5),
    label_end=(0.8, 1.1),
    far_share=0.3,
    far_m=(120.0, 320.0),
    distractors=5.0,
    cover_share=0.25,
    blur_px=(0.3, 1.6),
    vignette=(0.0, 0.4),
    noise_levels=(0.0, 9.0),
    contrast=(0.7, 1.25),
    brightness=0.1,
    gamma=(0.7, 1.35),
    cast=(0.92, 1.08),
    grey_share=0.15,
    jpeg_quality=(45, 98),
)
"""Any camera from 6 to 14 m in any state."""

ROADSIDE = SceneRange(
    name="roadside",
    shots=3,
    height_m=(8.0, 12.8),
    focal_px=(840.0, 1280.0),
    horizon_px=(20.0, 150.0),
    target_m=(30.0, 60.0),
    roll_deg=0.6,
    gaps_m=(5.0, 10.0, 20.0, 40.0),
    gap_shares=(0.15, 0.3, 0.35, 0.2),
    shape_weights=(6.0, 6.0, 5.0, 4.0, 2.6, 1.5, 2.2, 4.0),
    label_end=(0.65, 0.95),
    far_share=0.12,
    far_m=(100.0, 200.0),
    distractors=4.0,
    cover_share=0.1,
    blur_px=(0.3, 0.9),
    vignette=(0.0, 0.3),
    noise_levels=(0.0, 4.5),
    contrast=(0.85, 1.15),
    brightness=0.05,
    gamma=(0.85, 1.2),
    cast=(0.96, 1.04),
    grey_share=0.05,
    jpeg_quality=(60, 98),
)
"""A pole of 8 to 12.8 m as StreetDrive and a city pilot have it, in working order."""

RIDERS = replace(ROADSIDE, name="riders", shape_weights=(4.0, 4.0, 3.5, 3.0, 2.0, 1.2, 1.6, 14.0))
"""The roadside with many motorcycles, the class that is smallest in the picture; training only."""

QUEUES = replace(
    ROADSIDE,
    name="queues",
    gaps_m=(0.5, 1.5, 4.0, 10.0),
    gap_shares=(0.35, 0.3, 0.2, 0.15),
)
"""The roadside in a jam, where each vehicle hides part of the next; training only."""

CONDITIONS = ("night", "rain", "fog", "low sun", "snow", "dirt", "motion")
"""Kinds of conditions; "motion" is a long exposure of fast vehicles, and a strong compression."""

BY_CONDITION = tuple(
    replace(ROADSIDE, name=kind.replace(" ", "-"), conditions=(kind,), jpeg_quality=(25, 95))
    for kind in CONDITIONS
)
"""The roadside under each kind of conditions."""

VARIED = replace(
    ROADSIDE,
    name="varied",
    height_m=(5.0, 14.0),
    focal_px=(780.0, 2400.0),
    horizon_px=(-320.0, 170.0),
    target_m=(25.0, 90.0),
    roll_deg=2.0,
    shape_weights=(6.0, 6.0, 6.0, 4.0, 2.6, 2.0, 1.6, 3.0),
    blur_px=(0.3, 1.8),
    noise_levels=(0.0, 7.0),
    contrast=(0.7, 1.25),
    brightness=0.1,
    gamma=(0.7, 1.35),
    cast=(0.9, 1.1),
    grey_share=0.1,
    jpeg_quality=(25, 98),
    conditions=("clear", "clear", "clear", "low sun", "rain", "fog", "night", "dirt", "motion"),
    variety=True,
)
"""Vehicles and surroundings of any colour, by any camera up to a long lens; training only."""


def draw_conditions(rng: np.random.Generator, kinds: Sequence[str]) -> Conditions:
    """Conditions of one of the kinds, and at night or in bad weather often of two."""
    kind = kinds[int(rng.integers(len(kinds)))]
    given = CLEAR
    if kind in ("night", "low sun"):
        given = replace(given, night=kind == "night", low_sun=kind == "low sun")
    if kind == "rain" or (kind == "night" and rng.random() < 0.35):
        given = replace(given, rain_mm_h=float(np.exp(rng.uniform(np.log(1), np.log(70)))))
    if kind == "snow":
        given = replace(given, snow_mm_h=float(np.exp(rng.uniform(np.log(0.3), np.log(5)))))
    if kind == "fog":
        given = replace(given, visibility_m=float(np.exp(rng.uniform(np.log(60), np.log(500)))))
    if kind == "dirt" or rng.random() < 0.1:
        given = replace(given, dirt=float(rng.uniform(0.1, 1.0)))
    if kind == "motion":
        given = replace(given, exposure_s=float(rng.uniform(0.01, 0.04)))
    elif kind == "night":
        given = replace(given, exposure_s=float(rng.uniform(0.004, 0.03)))
    return given
