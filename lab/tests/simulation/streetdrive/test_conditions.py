"""Night, rain, fog, low sun, snow, dirt, compression and motion do to pictures what they should."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive import ClipSettings, Conditions
from slipstream_lab.simulation.streetdrive.clip import PALETTE, ClipRenderer
from slipstream_lab.simulation.streetdrive.rendering import (
    CLEAR,
    Codec,
    Density,
    Lens,
    PinholeCamera,
    PlacedMesh,
    Stage,
    draw_light,
)
from slipstream_lab.simulation.streetdrive.traffic import Road
from slipstream_lab.simulation.streetdrive.vehicles import build_vehicle

CAMERA = PinholeCamera(10.0, 6.0, 0.28, -0.1, 520.0, width_px=640, height_px=360)
LIGHT = replace(draw_light(np.random.default_rng(3)).exposed(1.2), haze_m=2000.0)
RED = [(30.0, 24.0, 200.0)]


def stage(conditions: Conditions, density: Density | None = None) -> Stage:
    """A small scene without trees and buildings."""
    return Stage(
        CAMERA,
        Road(),
        LIGHT,
        PALETTE,
        np.random.default_rng(5),
        density=density or Density(0.0, 0.0, 0.0),
        tree_shadows=0,
        conditions=conditions,
        weather=np.random.default_rng(6),
    )


def car(x_m: float, heading: int, speed_mps: float = 0.0) -> PlacedMesh:
    """A red car in the inner lane of its direction."""
    mesh = build_vehicle("hatch", np.random.default_rng(1), RED)
    return PlacedMesh(mesh, x_m, -2.05 * heading, heading, speed_mps=speed_mps)


def grey(image: np.ndarray) -> np.ndarray:
    """Mean level of each pixel."""
    return image.astype(np.float64).mean(axis=2)


def at(x_m: float, y_m: float, image: np.ndarray, half: int = 2) -> np.ndarray:
    """Mean colour of a few pixels round a road point."""
    (u, v) = CAMERA.project(np.array([[x_m, y_m, 0.0]]))[0][0].round().astype(int)
    return image[v - half : v + half + 1, u - half : u + half + 1].reshape(-1, 3).mean(axis=0)


def lens(conditions: Conditions, light=LIGHT) -> Lens:
    """The lens of the small camera."""
    return Lens(conditions, CAMERA, light, np.random.default_rng(7))


def test_night_is_dark_but_for_lamps():
    """Lamps light the road under them, headlamps the road ahead; tail lamps glow red."""
    lit = Density(0.0, 0.0, 8.0)
    day, _ = stage(CLEAR, lit).render([])
    scene = stage(Conditions(night=True), lit)
    empty, _ = scene.render([])
    assert grey(empty).mean() < 0.4 * grey(day).mean()
    lamps = [lamp for lamp in scene.light.lamps if 30 < lamp[0] < 80 and lamp[1] > 0]
    x = lamps[0][0]
    below, between = at(x, 4.0, empty).mean(), at(x + 15.0, 4.0, empty).mean()
    assert below / at(x, 4.0, day).mean() > 1.3 * between / at(x + 15.0, 4.0, day).mean()

    dark = stage(Conditions(night=True))
    before, _ = dark.render([])
    after, seen = dark.render([car(50.0, -1), car(45.0, 1)])
    ahead, behind = (at(x, 2.05, after).mean() - at(x, 2.05, before).mean() for x in (40.0, 60.0))
    assert ahead > 20
    assert ahead > 3 * behind
    x1, y1, x2, y2 = (int(c) for c in seen[0].box_px)
    assert grey(after)[y1:y2, x1:x2].max() > 230
    x1, y1, x2, y2 = (int(c) for c in seen[1].box_px)
    tail = after[y1:y2, x1:x2].reshape(-1, 3).astype(int)
    assert (tail[:, 2] - tail[:, 0]).max() > 150


def test_fog_takes_contrast_by_koschmiedes_law():
    """At the visibility range 2 % of contrast are left, and in the picture the far car fades."""
    given = Conditions(visibility_m=100.0)
    light = given.light(LIGHT, np.random.default_rng(1))
    assert math.exp(-100.0 / light.fog_m) == pytest.approx(0.02, abs=0.001)

    def contrast(conditions: Conditions, x_m: float) -> float:
        scene = stage(conditions)
        without, _ = scene.render([])
        image, seen = scene.render([car(x_m, 1)])
        x1, y1, x2, y2 = (int(c) for c in seen[0].box_px)
        return float(np.abs(grey(image) - grey(without))[y1:y2, x1:x2].mean())

    near = contrast(given, 20.0) / contrast(CLEAR, 20.0)
    far = contrast(given, 80.0) / contrast(CLEAR, 80.0)
    assert far < 0.35
    assert near > 2 * far


def test_rain_streaks_mirrors_and_dims():
    """Streaks move from frame to frame, more of them at a higher rate; the wet road mirrors."""
    flat = np.full((360, 640, 3), 90, dtype=np.uint8)
    changed = []
    for rate in (3.0, 40.0):
        glass = lens(Conditions(rain_mm_h=rate))
        first, second = glass.gather(flat), glass.gather(flat)
        assert not np.array_equal(first, second)
        changed.append(float(np.mean(np.abs(first.astype(int) - second) > 3)))
    assert 0 < changed[0] < 0.5 * changed[1]
    assert Conditions(rain_mm_h=10.0).extinction_per_m == pytest.approx(0.00156, rel=0.01)

    redder = []
    for scene in (stage(CLEAR), stage(Conditions(rain_mm_h=1.9))):
        empty = scene.render([])[0].astype(float)
        image, seen = scene.render([car(40.0, -1)])
        u, v = int((seen[0].box_px[0] + seen[0].box_px[2]) / 2), int(seen[0].box_px[3])
        gain = (image - empty)[v + 3 : v + 8, u - 3 : u + 4]
        redder.append(float(gain[..., 2].mean() - gain[..., 0].mean()))
    assert redder[1] > redder[0] + 5
    dry, _ = stage(CLEAR).render([])
    assert at(15.0, 2.05, empty).mean() < 0.9 * at(15.0, 2.05, dry).mean()


def test_a_low_sun_throws_long_shadows_and_glares():
    """A car darkens more road than at noon; a sun ahead adds glare, a sun behind none."""

    def darkened(conditions: Conditions) -> int:
        scene = stage(conditions)
        change = grey(scene.render([])[0]) - grey(scene.render([car(40.0, 1)])[0])
        return int(np.count_nonzero(change > 12))

    assert darkened(Conditions(low_sun=True)) > 1.5 * darkened(CLEAR)
    flat = np.full((360, 640, 3), 90, dtype=np.uint8)
    given = Conditions(low_sun=True)
    ahead = replace(LIGHT, sun=(0.99, 0.0, 0.12))
    behind = replace(LIGHT, sun=(-0.99, 0.0, 0.12))
    assert lens(given, ahead).gather(flat).max() > 200
    assert np.array_equal(lens(given, behind).gather(flat), flat)


def test_snow_whitens_the_verge_but_not_the_wheel_tracks():
    """Verges are white, tracks darker than the strip between them, and flakes fall."""
    image, _ = stage(Conditions(snow_mm_h=1.0)).render([])
    green, _ = stage(CLEAR).render([])
    assert at(50.0, -14.0, image).mean() > 1.4 * at(50.0, -14.0, green).mean()
    lane = Road().lanes[0].y_m
    tracks, strip = (
        np.mean([at(x, lane + y, image, 1) for x in range(15, 40)]) for y in (0.8, 0.0)
    )
    assert tracks < strip - 5
    flat = np.full((360, 640, 3), 90, dtype=np.uint8)
    flakes = lens(Conditions(snow_mm_h=2.0)).gather(flat)
    assert 0.001 < np.mean(flakes > 110) < 0.3


def test_dirt_stays_where_it_is_and_dims():
    """More dirt, less contrast behind it; it is the same in each frame."""
    board = np.kron(np.indices((9, 16)).sum(axis=0) % 2, np.ones((40, 40))) * 180 + 30
    image = np.repeat(board[..., None], 3, axis=2).astype(np.uint8)
    contrasts = []
    for share in (0.2, 1.0):
        glass = lens(Conditions(dirt=share))
        first = glass.gather(image)
        assert np.array_equal(first, glass.gather(image))
        contrasts.append(float(first.std()) / float(image.std()))
    assert contrasts[1] < contrasts[0] < 1
    assert contrasts[1] < 0.85


def test_compression_repeats_blocks_that_hardly_change():
    """Noise alone sends no block anew, a change does; low quality loses more than high."""
    rng = np.random.default_rng(2)
    image = cv2.GaussianBlur(rng.integers(0, 255, (160, 320, 3)).astype(np.uint8), (0, 0), 2)
    noisy = np.clip(image.astype(int) + rng.integers(-1, 2, image.shape), 0, 255).astype(np.uint8)
    moved = noisy.copy()
    moved[64:96, 64:96] = 255
    codec = Codec(15)
    first, second, third = (codec.code(frame) for frame in (image, noisy, moved))
    assert np.array_equal(first, second)
    assert third[70:90, 70:90].mean() > 240
    assert np.array_equal(third[:48], first[:48])
    loss = [np.abs(Codec(q).code(image).astype(int) - image).mean() for q in (10, 90)]
    assert loss[0] > 2 * loss[1]
    assert Codec(100).code(image) is image


def test_only_what_moves_blurs():
    """A fast car's edges are drawn out along its way; a standing one is as sharp as ever."""
    sharp, blurred = stage(CLEAR), stage(Conditions(exposure_s=0.04))
    still = blurred.render([car(20.0, -1)])[0]
    assert np.array_equal(still, sharp.render([car(20.0, -1)])[0])
    fast, seen = blurred.render([car(20.0, -1, speed_mps=25.0)])
    x1, y1, x2, y2 = (int(c) for c in seen[0].box_px)
    inside = np.s_[y1:y2, x1:x2]
    detail = [cv2.Laplacian(grey(image)[inside], cv2.CV_64F).std() for image in (still, fast)]
    assert detail[1] < 0.75 * detail[0]
    # Exposure is centred on the moment of truth, so the blur reaches beyond the box.
    assert np.abs(grey(fast) - grey(still))[y1 - 4 : y1 - 1, x1:x2].mean() > 1.5


@pytest.mark.long
def test_truth_camera_and_traffic_do_not_depend_on_conditions():
    """Same seed, any weather: the same rows."""
    wild = Conditions(night=True, rain_mm_h=20.0, dirt=0.4, jpeg_quality=30, exposure_s=0.02)
    settings = ClipSettings(seconds=0.2, fps=10.0, scenario="paper", seed=2)
    clear, changed = (
        list(ClipRenderer(replace(settings, conditions=given)).frames()) for given in (CLEAR, wild)
    )
    assert [rows for _, rows in clear] == [rows for _, rows in changed]
    assert clear[0][1]
    for (a, _), (b, _) in zip(clear, changed, strict=True):
        assert np.abs(a.astype(int) - b).mean() > 10


def test_same_seed_gives_the_same_picture():
    """What is drawn by chance in any weather comes from the generators that are given."""
    wild = Conditions(night=True, rain_mm_h=20.0, dirt=0.4, exposure_s=0.02)
    first, again = (
        lens(wild).gather(stage(wild).render([car(30.0, -1, speed_mps=20.0)])[0]) for _ in range(2)
    )
    assert np.array_equal(first, again)


@pytest.mark.parametrize(
    ("given", "key"),
    [
        ({"night": True, "low_sun": True}, "low_sun"),
        ({"rain_mm_h": -1.0}, "rain_mm_h"),
        ({"snow_mm_h": float("nan")}, "snow_mm_h"),
        ({"visibility_m": 5.0}, "visibility_m"),
        ({"dirt": 1.5}, "dirt"),
        ({"jpeg_quality": 0}, "jpeg_quality"),
        ({"exposure_s": 0.2}, "exposure_s"),
    ],
)
def test_conditions_out_of_range_are_refused(given, key):
    """A wrong value raises InputError that names its key."""
    with pytest.raises(InputError) as caught:
        Conditions(**given)
    assert caught.value.key == key
