"""Training scenes are reproducible, labelled by the rule, and apart from the held-out ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from slipstream_lab.simulation.streetdrive.rendering.painter import PlacedMesh, Seen, measure
from slipstream_lab.simulation.streetdrive.traffic.road import Road
from slipstream_lab.simulation.streetdrive.vehicles.catalogue import (
    CLASS_OF_SHAPE,
    CLASSES,
    PAINTS,
    build_vehicle,
)
from slipstream_lab.simulation.training.dataset import yolo_lines
from slipstream_lab.simulation.training.ranges import ROADSIDE, WIDE
from slipstream_lab.simulation.training.scenes import (
    _HELD_OUT_PAINTS,
    _HELD_OUT_SURFACES,
    _TRAIN_SURFACES,
    HELD_OUT,
    SPLITS,
    TRAIN,
    draw_camera,
    draw_road,
    draw_vehicles,
    keeps_label,
    render_shots,
)


@pytest.mark.parametrize(
    ("height_px", "fraction", "kept"),
    [(16.0, 0.4, True), (15.9, 1.0, False), (40.0, 0.39, False), (40.0, 0.41, True)],
)
def test_label_rule(height_px, fraction, kept):
    """A box stays when it is 8 px high at 640 wide and at least 40 % of the vehicle shows."""
    box = (100.0, 100.0, 150.0, 100.0 + height_px)
    assert keeps_label(Seen(box, box, fraction), 0.5) is kept


@pytest.mark.long
def test_scene_is_reproducible_and_labels_parse():
    """The same index gives the same picture and labels; YOLO lines hold relative numbers."""
    one_shot = replace(ROADSIDE, shots=1)
    (a,), (b,) = render_shots(HELD_OUT, 3, 1, one_shot), render_shots(HELD_OUT, 3, 1, one_shot)
    assert np.array_equal(a.image, b.image)
    assert a.labels == b.labels
    assert a.image.shape == (360, 640, 3)
    assert a.labels
    for line, label in zip(yolo_lines(a).splitlines(), a.labels, strict=True):
        number, cx, cy, w, h = line.split()
        assert 0 <= int(number) < len(CLASSES)
        assert all(0 <= float(v) <= 1 for v in (cx, cy, w, h))
        assert float(h) * 360 >= 8 - 1e-3
        assert (float(cx) - float(w) / 2) * 640 == pytest.approx(label[1], abs=1e-2)


@pytest.mark.parametrize("limits", [WIDE, ROADSIDE], ids=lambda limits: limits.name)
def test_splits_share_no_camera(limits):
    """Camera heights and focal lengths of the two splits fall in different bins."""
    heights: dict[str, set[int]] = {split: set() for split in SPLITS}
    focals: dict[str, set[int]] = {split: set() for split in SPLITS}
    for split in SPLITS:
        rng = np.random.default_rng(0)
        for _ in range(200):
            camera = draw_camera(rng, Road(), split, limits)
            heights[split].add(int(camera.height_m / 0.4))
            focals[split].add(int(camera.focal_px / 40.0))
    assert heights[HELD_OUT]
    assert not heights[TRAIN] & heights[HELD_OUT]
    assert not focals[TRAIN] & focals[HELD_OUT]


def test_splits_share_no_paint():
    """No paint of the held-out split is near one that training pictures have."""
    distances = np.abs(np.array(_HELD_OUT_PAINTS)[:, None] - np.array(PAINTS)[None]).max(axis=2)
    assert distances.min() > 6
    assert not set(_HELD_OUT_SURFACES) & set(_TRAIN_SURFACES)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_drawn_vehicles_do_not_overlap(seed):
    """In each lane one vehicle ends before the next begins."""
    rng = np.random.default_rng(seed)
    road = draw_road(rng)
    placed = draw_vehicles(rng, road, draw_camera(rng, road, TRAIN), [(90, 90, 90)])
    assert placed
    for lane in road.lanes:
        row = sorted(
            (p.x_m, p.mesh.length_m) for p in placed if abs(p.y_m - lane.y_m) <= 0.9 + 1e-9
        )
        for (x_a, l_a), (x_b, l_b) in pairwise(row):
            assert x_b - l_b / 2 >= x_a + l_a / 2


@pytest.mark.parametrize("shape", list(CLASS_OF_SHAPE))
def test_meshes_have_the_size_they_claim(shape):
    """A mesh stands on the ground and its length spans what it says; mirrors may stick out."""
    mesh = build_vehicle(shape, np.random.default_rng(2))
    span = np.ptp(mesh.outline, axis=0)
    assert mesh.outline[:, 2].min() == pytest.approx(0.0, abs=0.02)
    assert span[0] == pytest.approx(mesh.length_m, abs=0.25)
    assert mesh.width_m - 0.1 <= span[1] <= mesh.width_m + 0.55
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(len(mesh.normals)))


def test_visible_fraction_counts_what_nearer_vehicles_hide():
    """Alone a vehicle is wholly visible; right behind a lorry hardly any of it is."""
    camera = draw_camera(np.random.default_rng(4), Road(), TRAIN)
    rng = np.random.default_rng(0)
    car, lorry = build_vehicle("hatch", rng), build_vehicle("lorry", rng)
    y = camera.lateral_m
    far_car = PlacedMesh(car, 60.0, y, -1)
    assert measure(camera, [far_car])[0].visible_fraction == pytest.approx(1.0, abs=0.02)
    near_lorry = PlacedMesh(lorry, 60.0 - 2.5 - lorry.length_m / 2 - 0.5, y, -1)
    hidden, whole = measure(camera, [far_car, near_lorry])
    assert hidden.visible_fraction < 0.6
    assert whole.visible_fraction == pytest.approx(1.0, abs=0.02)
