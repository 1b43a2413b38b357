"""What vehicles hide of a segment, and what follows from it."""

from __future__ import annotations

import numpy as np
import pytest

from edge_daemon.camera import Camera
from edge_daemon.features.occlusion import (
    OCCLUSION_CORRECTIONS,
    OcclusionCorrection,
    VirtualCars,
    correct_for_occlusion,
    occlusion_ratio,
)
from edge_daemon.tracking import Sightings
from slipstream.messages import Estimate, KinematicFeatures

SEEN = KinematicFeatures(
    mean_speed_mps=Estimate(value=4.0, standard_error=0.03),
    mean_acceleration_mps2=Estimate(value=-0.1, standard_error=0.05),
    density_veh_per_m=Estimate(value=0.15, standard_error=0.001),
    speed_std_mps=Estimate(value=2.0, standard_error=0.04),
    acceleration_variance_m2ps4=Estimate(value=0.9, standard_error=0.08),
    mean_gap_m=None,
)


def boxes_at(camera: Camera, points_m: list[tuple[float, float]], height_m: float) -> Sightings:
    """Vehicles of 2 m by a height, seen at road points over ten seconds, four times a second."""
    assert camera.pose is not None
    boxes = []
    for x, y in points_m:
        feet = [(x, y - 1.0, 0.0), (x, y + 1.0, 0.0), (x, y - 1.0, height_m), (x, y, height_m)]
        corners = camera.pose.project(feet)
        boxes.append([*corners.min(axis=0), *corners.max(axis=0)])
    times = np.repeat(np.arange(0.0, 10.0, 0.25), len(points_m))
    n = len(times)
    return Sightings(
        np.zeros(n, np.int64),
        times,
        np.zeros((n, 2)),
        np.zeros((n, 2, 2)),
        np.zeros((n, 2)),
        np.zeros(n, np.int64),
        np.tile(np.array(boxes, np.float32).reshape(-1, 4), (n // max(len(boxes), 1), 1)),
    )


def places(camera: Camera) -> VirtualCars:
    """Of the camera's only segment, 20 to 80 m from it, two lanes."""
    assert camera.pose is not None
    return VirtualCars(camera.segments[0], camera.pose)


def test_an_empty_road_hides_nothing_and_a_lorry_hides_what_stands_behind_it(
    camera: Camera,
) -> None:
    """Behind, not before: at the far end of the segment there is nothing left to hide."""
    road = places(camera)
    assert road.occluded_share(boxes_at(camera, [(40.0, 1.75)], 4.0).take(slice(0, 0)), 0.0) == 0
    near = road.occluded_share(boxes_at(camera, [(25.0, 1.75)], 4.0), 0.0)
    far = road.occluded_share(boxes_at(camera, [(78.0, 1.75)], 4.0), 0.0)
    car = road.occluded_share(boxes_at(camera, [(25.0, 1.75)], 1.5), 0.0)
    assert 0.05 < near < 0.5
    assert far == 0
    assert car < near


def test_vehicles_at_their_places_do_not_hide_themselves(camera: Camera) -> None:
    """One far ahead of the next hides nothing: a car is 1.5 m high and the camera hangs at 9 m."""
    apart = boxes_at(camera, [(25.0, 1.75), (50.0, 1.75)], 1.5)
    assert places(camera).occluded_share(apart, 0.0) < 0.08


def test_what_was_hidden_before_the_window_or_for_a_part_of_it_counts_for_that_much(
    camera: Camera,
) -> None:
    """A lorry seen over half of the time hides half as much; instants without vehicles count."""
    road, lorry = places(camera), boxes_at(camera, [(25.0, 1.75)], 4.0)
    car = boxes_at(camera, [(79.0, 1.75)], 1.5)
    always = road.occluded_share(lorry, 0.0)
    half = road.occluded_share(
        Sightings.join([lorry.take(lorry.time_s < 5.0), car.take(car.time_s >= 5.0)]), 0.0
    )
    assert half == pytest.approx(always / 2, rel=0.1)
    assert road.occluded_share(
        Sightings.join([lorry.take(lorry.time_s < 5.0), car.take(car.time_s >= 5.0)]), 5.0
    ) == pytest.approx(0.0)
    pause = lorry.take((lorry.time_s < 2.0) | (lorry.time_s >= 8.0))
    assert road.occluded_share(pause, 0.0) < 0.6 * always


def test_where_nothing_is_hidden_values_stay_and_errors_never_shrink() -> None:
    """The allowance's constant part alone is added, in quadrature."""
    got = correct_for_occlusion(SEEN, 0.0)
    for name in OCCLUSION_CORRECTIONS:
        before, after = getattr(SEEN, name), getattr(got, name)
        if before is not None:
            assert after.value == before.value
            assert after.standard_error > before.standard_error
    assert got.mean_gap_m is None


def test_the_more_is_hidden_the_denser_and_slower_traffic_is_and_the_less_is_known() -> None:
    """At a third hidden, h = 1/2: exactly bias · h of the scale."""
    some, much = correct_for_occlusion(SEEN, 1 / 3), correct_for_occlusion(SEEN, 0.55)
    bias = OCCLUSION_CORRECTIONS["density_veh_per_m"].bias
    assert some.density_veh_per_m.value == pytest.approx(0.15 * (1 + bias / 2))
    assert much.density_veh_per_m.value > some.density_veh_per_m.value
    assert much.mean_speed_mps.value < some.mean_speed_mps.value < 4.0
    assert (much.density_veh_per_m.standard_error or 0) > (
        some.density_veh_per_m.standard_error or 0
    )


def test_no_share_however_large_makes_nonsense() -> None:
    """The ratio is bounded, and what cannot be negative is not."""
    assert occlusion_ratio(1.0) == occlusion_ratio(0.6) == pytest.approx(1.5)
    gone = correct_for_occlusion(
        SEEN, 1.0, dict.fromkeys(OCCLUSION_CORRECTIONS, OcclusionCorrection(-5.0, 0.1, 0.1))
    )
    assert gone.mean_speed_mps.value == 0.0
    assert gone.density_veh_per_m.value == 0.0
    assert gone.mean_acceleration_mps2.value < -0.1
