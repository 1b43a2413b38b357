"""The parts of a SUMO view: example traffic, vehicles, roads, and their painting."""

from __future__ import annotations

import math
from collections import defaultdict

import numpy as np
import pytest

from slipstream_lab.simulation.rsus import SceneSettings
from slipstream_lab.simulation.streetdrive.clip import PALETTE
from slipstream_lab.simulation.streetdrive.rendering.camera import PinholeCamera
from slipstream_lab.simulation.streetdrive.rendering.ground import view_ground
from slipstream_lab.simulation.streetdrive.rendering.painter import PlacedMesh, measure
from slipstream_lab.simulation.streetdrive.vehicles.catalogue import CLASS_OF_SHAPE, build_vehicle
from slipstream_lab.simulation.sumo_view.examples import find_additional, find_net, find_routes
from slipstream_lab.simulation.sumo_view.ground import paint_roads
from slipstream_lab.simulation.sumo_view.lanes import Carriageway, LaneRoads
from slipstream_lab.simulation.sumo_view.polylines import at, distances, shifted, stretch
from slipstream_lab.simulation.sumo_view.pose import CameraSite
from slipstream_lab.simulation.sumo_view.roadside import RoadsidePlan, choose_objects
from slipstream_lab.simulation.sumo_view.shapes import Kind, is_known, mesh_of
from slipstream_lab.simulation.sumo_view.traffic import STEP_S, State, between
from slipstream_lab.simulation.sumo_view.world import SumoViewWorld, drive

MAX_SPEED_CV, MAX_ACCELERATION_VARIANCE = 0.12, 0.5
"""The paper's rule (section V-A)."""


@pytest.mark.long
@pytest.mark.parametrize(
    ("routes", "begin_s", "stable"), [("calm", 45.0, True), ("rough", 60.0, False)]
)
def test_built_in_routes_are_what_their_names_say(routes, begin_s, stable):
    """By the paper's rule the calm example is stable in each 10 s window, the rough one in none."""
    seen: dict[int, list[tuple[float, ...]]] = defaultdict(list)
    with SumoViewWorld(
        find_net("avenue"), (find_routes(routes),), find_additional(routes, []), 3
    ) as world:
        world.subscribe_around(140.0, 0.0, 60.0)
        for frame, vehicles in enumerate(drive(world, begin_s, 5.0, 75)):
            for vehicle in vehicles:
                if 115 < vehicle.x_m < 173 and vehicle.y_m > 0:
                    sample = (vehicle.number, vehicle.speed_mps, vehicle.acceleration_mps2)
                    # Windows of 50 frames begin at frames 0 and 25.
                    for window in (0, 25):
                        if window <= frame < window + 50:
                            seen[window].append(sample)
    assert len(seen) == 2
    for samples in seen.values():
        numbers, speed, acceleration = np.array(samples).T
        assert len(set(numbers)) >= 8
        calm = speed.std() / speed.mean() <= MAX_SPEED_CV
        assert (calm and acceleration.var() <= MAX_ACCELERATION_VARIANCE) == stable


def test_between_steps_the_acceleration_is_held():
    """Half a step on, speed is linear and the way is that of constant acceleration."""
    before = State(10.0, 5.0, math.pi - 0.01, 10.0, 0.5)
    way = 10.04 * STEP_S
    after = State(10.0 - way, 5.0, -math.pi + 0.01, 10.08, 4.0)
    half = between(before, after, STEP_S / 2)
    assert half.speed_mps == pytest.approx(10.04)
    assert half.x_m == pytest.approx(10.0 - (10.0 * 0.01 + 4.0 * 0.01**2 / 2))
    assert half.acceleration_mps2 == 4.0
    # Headings on both sides of west meet there and not in the east.
    assert abs(math.remainder(half.heading_rad - math.pi, 2 * math.pi)) < 1e-3
    assert between(before, after, 0.0) == before
    standing = State(1.0, 2.0, 0.0, 0.0, 0.0)
    assert between(standing, standing, 0.01) == standing


@pytest.mark.parametrize(
    ("vclass", "length_m", "width_m", "expected"),
    [
        ("passenger", 4.3, 1.8, "car"),
        ("passenger", 7.5, 2.2, "car"),
        ("delivery", 6.5, 2.16, "car"),
        ("taxi", 5.0, 1.8, "car"),
        ("truck", 7.1, 2.4, "truck"),
        ("trailer", 16.5, 2.55, "truck"),
        ("bus", 12.0, 2.5, "bus"),
        ("motorcycle", 2.2, 0.9, "motorcycle"),
    ],
)
def test_vehicles_have_sumos_class_length_and_width(vclass, length_m, width_m, expected):
    """The mesh is of the class and reaches over SUMO's length and width, but for mirrors."""
    for seed in range(4):
        mesh = mesh_of(Kind(vclass, length_m, width_m), np.random.default_rng(seed))
        assert CLASS_OF_SHAPE[mesh.kind] == expected
        assert (mesh.length_m, mesh.width_m) == (length_m, width_m)
        reach = np.ptp(mesh.outline, axis=0)
        assert reach[0] == pytest.approx(length_m, rel=0.06)
        assert 0.9 * width_m < reach[1] < width_m + 0.6
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0)


def test_vehicles_without_a_shape_are_known_to_be_so():
    """Rail, water and foot are no road vehicles."""
    assert not any(is_known(vclass) for vclass in ("tram", "ship", "pedestrian", ""))


CAMERA = PinholeCamera(10.0, 0.0, math.radians(16), 0.0, 500.0, width_px=640, height_px=360)


def test_a_half_turn_is_the_other_heading():
    """A vehicle turned by π is seen as one with the opposite heading along x."""
    bus = build_vehicle("bus", np.random.default_rng(1))
    ahead = measure(CAMERA, [PlacedMesh(bus, 40.0, -3.0, -1)])[0]
    turned = measure(CAMERA, [PlacedMesh(bus, 40.0, -3.0, 1, math.pi)])[0]
    assert ahead is not None
    assert turned is not None
    assert turned.box_px == pytest.approx(ahead.box_px, abs=1e-3)


def test_a_quarter_turn_shows_the_side():
    """A bus turned across the road is much wider in the picture than one along it."""
    bus = build_vehicle("bus", np.random.default_rng(1))
    along = measure(CAMERA, [PlacedMesh(bus, 60.0, 0.0, 1)])[0]
    across = measure(CAMERA, [PlacedMesh(bus, 60.0, 0.0, 1, math.pi / 2)])[0]
    assert along is not None
    assert across is not None
    widths = [box[2] - box[0] for box in (along.box_px, across.box_px)]
    assert widths[1] > 3 * widths[0]


ANGLES = np.linspace(0.0, 0.6, 25)
ARC = np.column_stack([200 * np.sin(ANGLES), 200 * (1 - np.cos(ANGLES))])
"""A line that bends to the left with a radius of 200 m."""


def test_lines_are_shifted_along_their_bend():
    """A line moved to the left of a left-hand bend is shorter by angle times distance."""
    inner = shifted(ARC, 7.0)
    assert np.hypot(inner[:, 0], inner[:, 1] - 200) == pytest.approx(193.0, abs=0.01)
    length = distances(ARC)[-1]
    assert distances(inner)[-1] == pytest.approx(length - 0.6 * 7.0, abs=0.25)
    part = stretch(ARC, 20.0, 50.0)
    assert distances(part)[-1] == pytest.approx(30.0, abs=0.01)
    assert part[0] == pytest.approx(at(ARC, np.array([20.0]))[0])


def bent_roads() -> LaneRoads:
    """Two lanes that bend to the left, the left border along ARC."""
    way = Carriageway("bend", ARC, (3.5, 3.5), 0.0, float(distances(ARC)[-1]), False)
    return LaneRoads((way,), (), frozenset({"bend"}))


def test_asphalt_and_markings_follow_the_bend():
    """Lane middles are asphalt, the lane line is dashed with paint, the land beside is grass."""
    site = CameraSite(0.0, 3.0, 0.0)
    view = view_ground(CAMERA, np.random.default_rng(2))
    picture = paint_roads(view, CAMERA, bent_roads(), site, PALETTE)

    def tones(right_m: float) -> np.ndarray:
        line = site.to_local(at(shifted(ARC, -right_m), np.arange(25.0, 70.0, 0.25)))
        u, v = CAMERA.project(np.column_stack([line, np.zeros(len(line))]))[0].T
        return picture[v.astype(int), u.astype(int)]

    for middle in (1.75, 5.25):
        assert np.ptp(tones(middle).mean(axis=0)) < 6
        assert tones(middle).max() < 160
    paint = tones(3.5).min(axis=1) > 150
    assert 0.15 < paint.mean() < 0.5
    assert np.count_nonzero(np.diff(paint.astype(int)) == 1) >= 3
    for beside in (-6.0, 12.5):
        blue, green, _ = tones(beside).T
        assert np.mean(green - blue) > 20


def test_nothing_stands_on_the_road_or_before_it():
    """Buildings, trees and lamp posts leave the road and the sight of it free."""
    roads, site = bent_roads(), CameraSite(-10.0, 8.0, 0.0)
    plan = RoadsidePlan(roads, site)
    scene = SceneSettings(buildings=8.0, trees=30.0)
    things = choose_objects(plan, roads, site, scene, np.random.default_rng(3))
    kinds = [kind for _, kind, _ in things]
    assert {"building", "tree", "lamp"} == set(kinds)
    spots = np.array([[x, y] for x, _, y in things])
    assert plan.clearance_m(spots).min() > 0.2
    trees = spots[[kind == "tree" for kind in kinds]]
    assert not any(plan.occludes_road(spot[None], 200.0) for spot in trees)
    on_road = site.to_local(at(shifted(ARC, -3.5), np.arange(20.0, 100.0, 5.0)))
    assert plan.clearance_m(on_road).max() == 0.0
