"""Domain-randomised StreetDrive scenes with YOLO labels, for training and for holding out.

The two splits share no seed, no camera (heights and focal lengths come from disjoint bins) and no
palette (paints and surfaces come from disjoint lists), so the held-out figures are not recall.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from slipstream_lab.simulation.streetdrive.rendering import (
    CLEAR,
    Colour,
    Density,
    Image,
    Lens,
    Occluder,
    Palette,
    PinholeCamera,
    PlacedMesh,
    Seen,
    Sensor,
    SensorSettings,
    Stage,
    draw_light,
)
from slipstream_lab.simulation.streetdrive.traffic import Road
from slipstream_lab.simulation.streetdrive.vehicles import (
    CLASS_OF_SHAPE,
    CLASSES,
    PAINTS,
    build_vehicle,
)
from slipstream_lab.simulation.training.distractors import draw_distractors, draw_rails
from slipstream_lab.simulation.training.ranges import WIDE, SceneRange, Span, draw_conditions
from slipstream_lab.simulation.training.variety import (
    any_paint,
    any_palette,
    uneven_light,
    varied_mesh,
)

TRAIN, HELD_OUT = "train", "val"
SPLITS = (TRAIN, HELD_OUT)
IMAGE_WIDTH, IMAGE_HEIGHT = 640, 360
MIN_VISIBLE_FRACTION = 0.4
MIN_HEIGHT_PX = 8.0
"""A label's least height, in pixels of a picture 640 wide."""

_HELD_OUT_PAINTS: tuple[Colour, ...] = (
    (220, 225, 215),
    (175, 170, 178),
    (120, 122, 112),
    (65, 62, 68),
    (50, 80, 190),
    (60, 40, 90),
    (120, 110, 40),
    (90, 70, 60),
    (120, 175, 205),
)
_TRAIN_SURFACES = (
    Palette(),
    Palette(
        asphalt=(92, 90, 92),
        verge=(70, 118, 122),
        pavement=(140, 150, 158),
        buildings=((205, 210, 212), (95, 110, 140)),
        foliage=(38, 100, 80),
    ),
    Palette(
        asphalt=(138, 138, 140),
        verge=(58, 92, 72),
        pavement=(180, 182, 184),
        marking=(210, 222, 228),
        buildings=((140, 150, 150), (110, 95, 90), (90, 105, 150)),
        foliage=(60, 88, 50),
    ),
    Palette(
        asphalt=(122, 128, 134),
        verge=(105, 140, 160),
        pavement=(150, 160, 175),
        buildings=((170, 185, 205), (200, 195, 185)),
        foliage=(48, 80, 78),
    ),
)
_HELD_OUT_SURFACES = (
    Palette(
        asphalt=(104, 108, 112),
        verge=(46, 104, 74),
        pavement=(166, 158, 152),
        buildings=((130, 145, 165), (185, 180, 190)),
        foliage=(34, 92, 58),
    ),
    Palette(
        asphalt=(128, 122, 118),
        verge=(82, 120, 140),
        pavement=(135, 142, 150),
        marking=(200, 215, 220),
        buildings=((110, 130, 150), (160, 150, 140)),
        foliage=(56, 96, 66),
    ),
)


@dataclass(frozen=True)
class TrainingScene:
    """One rendered picture (360, 640, 3) BGR with boxes as (class, x1, y1, x2, y2) in pixels."""

    image: Image
    labels: tuple[tuple[int, float, float, float, float], ...]


def keeps_label(seen: Seen, scale: float) -> bool:
    """The label rule: visible fraction >= 0.4 and box height >= 8 px at 640 wide."""
    height = (seen.box_px[3] - seen.box_px[1]) * scale
    return seen.visible_fraction >= MIN_VISIBLE_FRACTION and height >= MIN_HEIGHT_PX


def _reserved(value: float, bin_size: float) -> bool:
    """Whether a camera parameter lies in one of the bins kept for the held-out split."""
    return int(value / bin_size) % 4 == 3


def _uniform_in_split(
    rng: np.random.Generator, span: Span, bin_size: float, held_out: bool
) -> float:
    while True:
        value = float(rng.uniform(*span))
        if _reserved(value, bin_size) == held_out:
            return value


def draw_camera(
    rng: np.random.Generator, road: Road, split: str, limits: SceneRange = WIDE
) -> PinholeCamera:
    """A camera pose of one split, beside or above the road, with the road in view."""
    held_out = split == HELD_OUT
    height = _uniform_in_split(rng, limits.height_m, 0.4, held_out)
    focal = _uniform_in_split(rng, limits.focal_px, 40.0, held_out)
    lateral = rng.uniform(road.right_edge_m - 3.0, road.left_edge_m + 4.0)
    horizon = rng.uniform(*limits.horizon_px)
    target_x = rng.uniform(*limits.target_m)
    target_y = rng.uniform(road.right_edge_m * 0.6, road.left_edge_m * 0.8)
    return PinholeCamera(
        height_m=height,
        lateral_m=float(lateral),
        pitch_rad=math.atan((360.0 - horizon) / focal),
        yaw_rad=math.atan2(target_y - lateral, target_x),
        focal_px=focal,
        roll_rad=math.radians(float(rng.normal(0.0, limits.roll_deg))),
    )


def draw_road(rng: np.random.Generator) -> Road:
    """A road of one to three lanes a side."""
    return Road(
        incoming_lanes=int(rng.choice([1, 2, 2, 3])),
        outgoing_lanes=int(rng.choice([1, 2, 2, 3])),
        lane_width_m=float(rng.uniform(3.1, 3.75)),
        median_m=float(rng.choice([0.3, 0.6, 2.0])),
        pavement_m=float(rng.choice([0.0, 2.0, 3.0])),
    )


def draw_vehicles(
    rng: np.random.Generator,
    road: Road,
    camera: PinholeCamera,
    paints: Sequence[Colour],
    limits: SceneRange = WIDE,
) -> list[PlacedMesh]:
    """Vehicles along all lanes with a drawn mix and density; none overlap."""
    shares = rng.dirichlet(limits.shape_weights)
    shapes = tuple(CLASS_OF_SHAPE)
    # Where a car of 1.5 m falls under the label's least height.
    label_end = camera.focal_px / 2 * 1.5 / MIN_HEIGHT_PX
    near = rng.random() < 1 - limits.far_share
    end = float(label_end * rng.uniform(*limits.label_end) if near else rng.uniform(*limits.far_m))
    placed: list[PlacedMesh] = []
    for lane in road.lanes:
        gap = float(rng.choice(limits.gaps_m, p=limits.gap_shares))
        x = float(rng.uniform(0.0, 10.0 + gap))
        while x < end:
            shape = shapes[int(rng.choice(len(shapes), p=shares))]
            mesh = build_vehicle(shape, rng, [any_paint(rng)] * 2 if limits.variety else paints)
            if limits.variety:
                mesh = varied_mesh(mesh, rng)
            x += mesh.length_m / 2
            sway = rng.normal(0.0, 0.6 if shape == "motorcycle" else 0.2)
            y = lane.y_m + float(np.clip(sway, -0.9, 0.9))
            speed = float(rng.uniform(0.0, 35.0)) if limits.conditions else 0.0
            placed.append(PlacedMesh(mesh, x, y, lane.direction, speed_mps=speed))
            x += mesh.length_m / 2 + 1.5 + float(rng.exponential(gap))
    return placed


def draw_occluders(rng: np.random.Generator, share: float) -> list[Occluder]:
    """Now and then a post or a panel close to the camera that hides part of the road."""
    if rng.random() > share:
        return []
    u, wide = rng.uniform(50, 1230), rng.uniform(6, 40)
    tone = float(rng.uniform(40, 150))
    lean = rng.uniform(-30, 30)
    post = np.array([[u, 0.0], [u + wide, 0.0], [u + wide + lean, 720.0], [u + lean, 720.0]])
    occluders = [Occluder(post, (tone, tone, tone))]
    if rng.random() < 0.5:
        w, h, v = rng.uniform(40, 140), rng.uniform(40, 120), rng.uniform(0, 300)
        panel = np.array([[u - w / 2, v], [u + w / 2, v], [u + w / 2, v + h], [u - w / 2, v + h]])
        b, g, r = (float(c) for c in rng.uniform(30, 220, 3))
        occluders.append(Occluder(panel, (b, g, r)))
    return occluders


def _degrade(image: Image, rng: np.random.Generator, limits: SceneRange) -> Image:
    """Contrast, colour cast, gamma and haze of a cheap camera, at the label's picture size."""
    tone = image.astype(np.float32) / 255
    contrast, shift = rng.uniform(*limits.contrast), limits.brightness
    tone = np.clip((tone - 0.5) * contrast + 0.5 + rng.uniform(-shift, shift), 0, 1)
    cast = rng.uniform(*limits.gamma), rng.uniform(*limits.cast, 3).astype(np.float32)
    tone = tone ** cast[0] * cast[1]
    if rng.random() < limits.grey_share:
        grey = tone.mean(axis=2, keepdims=True)
        tone = grey + (tone - grey) * rng.uniform(0.0, 0.5)
    return np.asarray(np.clip(tone * 255, 0, 255), dtype=np.uint8)


def render_shots(split: str, index: int, seed: int, limits: SceneRange) -> list[TrainingScene]:
    """Draw stage number `index` of a split and render its shots; same arguments, same scenes."""
    rng = np.random.default_rng([seed, SPLITS.index(split), index])
    surfaces = _HELD_OUT_SURFACES if split == HELD_OUT else _TRAIN_SURFACES
    road = draw_road(rng)
    camera = draw_camera(rng, road, split, limits)
    # A generator of its own: a range without conditions draws the same scenes as ever.
    weather = np.random.default_rng([seed, SPLITS.index(split), index, 1])
    conditions = draw_conditions(weather, limits.conditions) if limits.conditions else CLEAR
    stage = Stage(
        camera,
        road,
        draw_light(rng),
        any_palette(rng) if limits.variety else surfaces[int(rng.integers(len(surfaces)))],
        rng,
        density=Density(rng.uniform(0, 9), rng.uniform(0, 16), rng.uniform(0, 8)),
        tree_shadows=int(rng.integers(0, 7)),
        occluders=draw_occluders(rng, limits.cover_share),
        conditions=conditions,
        weather=weather,
    )
    lens = Lens(conditions, camera, stage.light, weather)
    return [_shoot(stage, lens, split, rng, limits) for _ in range(limits.shots)]


def _shoot(
    stage: Stage, lens: Lens, split: str, rng: np.random.Generator, limits: SceneRange
) -> TrainingScene:
    """Fill a stage with vehicles, take its picture and label it."""
    camera, road = stage.camera, stage.road
    paints = _HELD_OUT_PAINTS if split == HELD_OUT else PAINTS
    vehicles = draw_vehicles(rng, road, camera, paints, limits)
    others = draw_distractors(rng, road, limits.distractors)
    if limits.variety:
        others += draw_rails(rng, road)
    picture, seen = stage.render([*vehicles, *others])
    picture = lens.gather(picture)
    if limits.variety and rng.random() < 0.5:
        picture = uneven_light(picture, rng)
    dark = rng.uniform(1.0, 8.0) if stage.conditions.night else 0.0
    state = SensorSettings(
        rng.uniform(*limits.blur_px),
        rng.uniform(*limits.vignette),
        rng.uniform(*limits.noise_levels) + dark,
    )
    picture = Sensor(state, camera.width_px, camera.height_px, rng).expose(picture)
    method = cv2.INTER_AREA if rng.random() < 0.5 else cv2.INTER_LINEAR
    small = np.asarray(
        cv2.resize(picture, (IMAGE_WIDTH, IMAGE_HEIGHT), interpolation=method), dtype=np.uint8
    )
    small = _degrade(small, rng, limits)
    quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(*limits.jpeg_quality))]
    coded = cv2.imencode(".jpg", small, quality)[1]
    small = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), dtype=np.uint8)
    scale = IMAGE_WIDTH / camera.width_px
    labels = []
    for vehicle, what in zip(vehicles, seen, strict=False):
        if what is not None and keeps_label(what, scale):
            number = CLASSES.index(CLASS_OF_SHAPE[vehicle.mesh.kind])
            x1, y1, x2, y2 = (value * scale for value in what.box_px)
            labels.append((number, x1, y1, x2, y2))
    return TrainingScene(small, tuple(labels))
