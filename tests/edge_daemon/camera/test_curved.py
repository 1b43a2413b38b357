"""Roads that bend, crest and sag, lenses that distort: geometry, fit, what speeds come to."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.calibration.calibration import calibrate
from edge_daemon.calibration.files import camera_toml, read_points
from edge_daemon.camera import Array, Camera, WatchedSegment, load_camera
from edge_daemon.camera.curved import CurvedRoad
from edge_daemon.camera.fit import (
    Observations,
    Projection,
    fit_road,
    line_misses_px,
    parameter_count,
)
from edge_daemon.camera.homography import Homography, Lines
from edge_daemon.camera.pose import pose_of
from edge_daemon.camera.selection import choose_road
from edge_daemon.detection.region import road_region
from edge_daemon.settings import CalibrationLine, CalibrationPoint, SegmentSettings
from slipstream.errors import InputError

from ..conftest import FOCAL_PX, POLE_M
from ..curved_roads import SCENES, SIZE, road

STATIONS = (18.0, 23.0, 29.0, 35.0, 42.0, 50.0, 58.0, 67.0, 78.0, 90.0)
ROAD = np.array([(x, y) for x in STATIONS for y in (-3.5, 3.5)])
WIDE = ROAD * (1.0, 2.6)
GRID = np.array([(x, y) for x in np.linspace(20, 85, 14) for y in (-2.0, 0.0, 2.0)])
SOURCE = Path("points.toml")
SEGMENT = SegmentSettings(
    id="bend", polygon=((22, -3.5), (80, -3.5), (80, 3.5), (22, 3.5)), direction=(-1, 0), lanes=2
)


def points_of(image: Array, places: Array = ROAD) -> tuple[CalibrationPoint, ...]:
    """Points as a file gives them."""
    return tuple(
        CalibrationPoint(image=(float(u), float(v)), road=(float(x), float(y)))
        for (u, v), (x, y) in zip(image, places, strict=True)
    )


def speed_errors(true: CurvedRoad, found: Projection) -> Array:
    """Relative errors of speeds along the road, all over the watched part."""
    pixels = true.to_image(GRID)
    flow = true.derivative(GRID)[:, :, 0]
    _, jacobian = found.to_road_with_jacobian(pixels)
    return np.asarray(np.einsum("nij,nj->ni", jacobian, flow)[:, 0] - 1)


@pytest.mark.parametrize("true", SCENES.values(), ids=SCENES.keys())
def test_the_road_maps_to_the_picture_and_back(true: CurvedRoad) -> None:
    """To a micrometre, with the derivative that differences give."""
    pixels = true.to_image(GRID)
    assert true.to_road(pixels) == pytest.approx(GRID, abs=1e-6)
    _, jacobian = true.to_road_with_jacobian(pixels)
    for axis in (0, 1):
        step = np.zeros(2)
        step[axis] = 1e-3
        difference = (true.to_road(pixels + step) - true.to_road(pixels - step)) / 2e-3
        assert jacobian[:, :, axis] == pytest.approx(difference, rel=1e-4, abs=1e-6)


def test_the_lens_is_that_of_opencv() -> None:
    """`cv2.projectPoints` with k₁ gives the same pixels."""
    true = road(lens=-0.12)
    k1 = -0.12 * (2 * FOCAL_PX / np.hypot(*SIZE)) ** 2
    matrix = np.array([[FOCAL_PX, 0, 640], [0, FOCAL_PX, 360], [0, 0, 1]])
    seen, _ = cv2.projectPoints(
        true.surface(GRID), true.rotation, true.shift_m, matrix, np.array([k1, 0, 0, 0])
    )
    assert true.to_image(GRID) == pytest.approx(seen.reshape(-1, 2), abs=1e-6)


def test_a_barrel_lens_shows_no_place_twice() -> None:
    """Far outside the view a place has no pixel; the search region still has all that is seen."""
    true = SCENES["barrel"]
    beside = np.array([(8.0, y) for y in np.linspace(-60, 60, 121)])
    pixels = true.to_image(beside)
    seen = np.isfinite(pixels[:, 0])
    assert 0 < seen.sum() < len(beside)
    assert (np.diff(pixels[seen, 0]) < 0).all()
    outline = np.array([(20.0, -3.5), (80.0, -3.5), (80.0, 3.5), (20.0, 3.5)])
    segment = WatchedSegment("s", outline, np.array([-1.0, 0.0]), 60.0, 2, 3.5)
    camera = Camera("c", SIZE, ROAD, true.to_image(ROAD), (segment,), projection=true)
    assert np.isnan(true.to_image([[1.0, 3.5]])).all()
    region = road_region(camera)
    assert region is not None
    (left, top), (right, _) = (f(true.to_image(GRID), axis=0) for f in (np.min, np.max))
    assert region.left <= left
    assert region.right >= right
    assert region.top <= top
    assert region.bottom >= true.to_image([[17.0, 0.0]])[0, 1]


def test_a_crest_hides_what_is_behind_it_and_the_sky_is_no_road() -> None:
    """A pixel just over the crest's line is the sky's; one under it lies before the summit."""
    true = road(crest=-1 / 400)
    rows = np.column_stack([np.full(720, 640.0), np.arange(720.0)])
    stations = true.to_road(rows)[:, 0]
    seen = np.isfinite(stations)
    edge = int(np.argmax(seen))
    assert edge > 0
    assert seen[edge:].all()
    assert (np.diff(stations[edge:]) < 0).all()
    behind = true.to_road(true.to_image([[150.0, 0.0]]))[0, 0]
    assert not behind > 140


@pytest.mark.slow
@pytest.mark.parametrize(
    "true",
    [
        pytest.param(true, id=name, marks=[] if " and " in name else [pytest.mark.long])
        for name, true in SCENES.items()
    ],
)
def test_careful_points_give_true_speeds_where_a_plane_is_far_off(true: CurvedRoad) -> None:
    """Twenty points to 0.3 px: speeds to 1 % on average, 2 % anywhere."""
    # What a lens does shows at the sides of the picture only.
    places = WIDE if true.distortion and not true.curvature_per_m else ROAD
    worst = []
    for seed in range(2):
        noise = np.random.default_rng(seed).normal(0, 0.3, ROAD.shape)
        known = Observations(places, true.to_image(places) + noise, Lines.none())
        found, _, used = choose_road(known, SIZE)
        assert used.all()
        errors = np.abs(speed_errors(true, found))
        worst.append(errors.max())
        assert errors.mean() < 0.01
    assert max(worst) < 0.02
    plane = Homography(places, true.to_image(places))
    assert np.abs(speed_errors(true, plane)).max() > 1.5 * max(worst)


@pytest.mark.slow
def test_a_plane_stays_a_plane() -> None:
    """Clicks a pixel off are no reason for a curve, nor is one mistake among them."""
    flat = road()
    for seed in range(4):
        image = flat.to_image(ROAD) + np.random.default_rng(seed).normal(0, 1.0, ROAD.shape)
        image[7 * (seed % 2)] += (0, 60 * (seed % 2))
        projection, terms, used = choose_road(Observations(ROAD, image, Lines.none()), SIZE)
        assert terms == ()
        assert isinstance(projection, Homography)
        assert used.sum() == len(ROAD) - seed % 2


@pytest.mark.long
def test_what_is_written_loads_as_the_same_camera(tmp_path: Path) -> None:
    """The file carries terms and lines; pose, region and outline follow the curve."""
    true = SCENES["bend of 150 m to the left"]
    seen = true.to_image([(x, 0.0) for x in (25.0, 50.0, 75.0)])
    line = CalibrationLine(offset=0.0, image=tuple((float(u), float(v)) for u, v in seen))
    result = calibrate(points_of(true.to_image(ROAD)), (SEGMENT,), SIZE, SOURCE, (line,))
    assert result.terms == ("arc",)
    assert any("put y = 0 in its middle" in said for said in result.warnings)
    path = tmp_path / "camera.toml"
    text = camera_toml("bend", result, (SEGMENT,), "x.png")
    path.write_text(text.replace('reference = "x.png"\n', ""))
    camera = load_camera(path)
    assert read_points(path).lines == (line,)
    assert camera.to_road(true.to_image(GRID)) == pytest.approx(GRID, abs=1e-3)
    assert camera.pose is not None
    assert camera.pose.height_m == pytest.approx(POLE_M, abs=0.01)
    raised = camera.pose.project(np.column_stack([GRID, np.zeros(len(GRID))]))
    assert raised == pytest.approx(camera.to_image(GRID), abs=1e-6)
    offset = camera.pose.centre_offset(
        GRID, np.tile([-1.0, 0.0], (len(GRID), 1)), np.tile([4.5, 1.8, 1.5], (len(GRID), 1))
    )
    assert (offset[:, 0] > 1).all()
    assert (offset[:, 0] < 4).all()
    assert len(camera.outline_px(camera.segments[0])) > 20
    region = road_region(camera)
    assert region is not None
    assert region.width < SIZE[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "true", [road(), pytest.param(SCENES["sag"], marks=pytest.mark.long)], ids=["plane", "sag"]
)
def test_lines_of_known_offset_steady_the_width(true: CurvedRoad) -> None:
    """With rough points and twelve sharp places on two lines, offsets are truer than without."""
    places = np.array([(x, y) for x in np.linspace(20, 85, 12) for y in (-3.5, 3.5)])
    lines = Lines(true.to_image(places), places[:, 1])
    terms = () if true.bend_per_m == 0 else ("crest",)
    with_lines, without = [], []
    for seed in range(4):
        image = true.to_image(ROAD) + np.random.default_rng(seed).normal(0, 1.5, ROAD.shape)
        for given, errors in ((lines, with_lines), (Lines.none(), without)):
            found = fit_road(Observations(ROAD, image, given), SIZE, terms)
            errors.append(np.abs((found.to_road(true.to_image(GRID)) - GRID)[:, 1]).max())
            assert line_misses_px(found, lines).shape == (24,)
    assert np.median(with_lines) < 0.7 * np.median(without)


@pytest.mark.long
def test_no_file_where_an_end_or_a_fifth_contradicts() -> None:
    """Points that are wrong together are named, and nothing is fitted round them."""
    flat = road().to_image(ROAD)
    far = ROAD.copy()
    far[-3:, 0] += (25.0, 31.0, 44.0)
    with pytest.raises(InputError, match=r"at one end of the road: 18, 19, 20"):
        calibrate(points_of(flat, far), (), SIZE, SOURCE, terms=())
    many = ROAD.copy()
    many[[1, 5, 8, 12, 17]] += [(0, 9), (0, -9), (14, 9), (-14, 9), (0, 11)]
    with pytest.raises(InputError, match=r"5 of 20 points contradict the others: 2, 6, 9, 13, 18"):
        calibrate(points_of(flat, many), (), SIZE, SOURCE)


def test_terms_say_how_many_points_they_need() -> None:
    """Two terms that are given need ten."""
    few = points_of(road().to_image(ROAD[:9]), ROAD[:9])
    with pytest.raises(InputError, match="9 points are given, the terms arc, crest need 10"):
        calibrate(few, (), SIZE, SOURCE, terms=("arc", "crest"))


def test_a_line_that_is_elsewhere_is_named() -> None:
    """An offset mistaken by two lanes is one line."""
    seen = road().to_image([(x, 0.0) for x in (20.0, 30.0)])
    line = CalibrationLine(offset=7.0, image=tuple((float(u), float(v)) for u, v in seen))
    with pytest.raises(InputError, match="the line at offset 7 m misses it by"):
        calibrate(points_of(road().to_image(ROAD)), (), SIZE, SOURCE, (line,))


def test_the_pose_of_a_plane_turns_as_its_curved_road_does() -> None:
    """A homography's pose and the same road without terms agree on rotation and place."""
    flat = road()
    pose = pose_of(Homography(ROAD, flat.to_image(ROAD)), SIZE)
    assert pose is not None
    assert pose.rotation == pytest.approx(flat.matrix, abs=1e-6)
    assert pose.height_m == pytest.approx(flat.height_m, abs=1e-5)
    assert parameter_count(("arc",)) == parameter_count(())


def test_old_files_and_constructors_give_a_plane(camera: Camera) -> None:
    """No key, no curve."""
    assert isinstance(camera.projection, Homography)
    assert len(camera.outline_px(camera.segments[0])) == 4


@pytest.mark.long
def test_points_in_a_small_part_of_the_picture_are_fitted() -> None:
    """Nine times as large as the part with points: OpenCV refuses some of the starts."""
    given = read_points(Path(__file__).parents[1] / "data" / "motorway-sag-points.toml")
    found = calibrate(given.points, given.segments, (1920, 1080), SOURCE, given.lines)
    assert found.used.all()
    assert found.reprojection_error_px < 0.5


@pytest.mark.long
def test_a_real_sag_is_fitted_from_one_row_of_dashes_and_two_edges() -> None:
    """A motorway that no plane fits better than 5 %: dashes left out of the fit are met to 1 %."""
    given = read_points(Path(__file__).parents[1] / "data" / "motorway-sag-points.toml")
    whole = calibrate(given.points, given.segments, (640, 360), SOURCE, given.lines)
    assert whole.terms == ("crest",)
    assert whole.used.all()
    assert whole.reprojection_error_px < 0.5
    assert isinstance(whole.projection, CurvedRoad)
    assert whole.projection.bend_per_m > 0
    half = calibrate(given.points[::2], (), (640, 360), SOURCE, given.lines, ("crest",))
    left_out = given.points[1::2]
    places = half.projection.to_road([point.image for point in left_out])[:, 0]
    true = np.array([point.road[0] for point in left_out])
    assert np.ptp(places) == pytest.approx(np.ptp(true), rel=0.01)
    assert np.abs(places - true).max() < 1.0
