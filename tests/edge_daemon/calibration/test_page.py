"""The calibration page: what it answers, to whom, and in a real browser on a clip with truth."""

from __future__ import annotations

import csv
import json
import threading
import time
import urllib.error
import urllib.request
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edge_daemon.calibration.files import read_points
from edge_daemon.calibration.guess import guess
from edge_daemon.calibration.page import PageServer
from edge_daemon.calibration.presets import LANE_MARKS
from edge_daemon.calibration.recording import Recording, record
from edge_daemon.calibration.session import Session
from edge_daemon.calibration.snapping import snap
from edge_daemon.camera import Camera, load_camera
from edge_daemon.detection import Detections
from edge_daemon.settings import BUILTIN_MODEL, PointsSettings
from slipstream.errors import InputError

from ..conftest import project
from ..curved_roads import SCENES

ROAD = [(x, y) for x in (18.0, 30.0, 45.0, 65.0, 90.0) for y in (-8.0, 8.0)]
SEGMENT = {
    "id": "approach",
    "polygon": [[20.0, 0.0], [80.0, 0.0], [80.0, 7.0], [20.0, 7.0]],
    "direction": [-1.0, 0.0],
    "lanes": 2,
    "lane_width_m": 3.5,
}
PERIOD_M, DASH_M = 9.0, 3.0
DASHES = next(i for i, m in enumerate(LANE_MARKS) if (m.period_m, m.dash_m) == (PERIOD_M, DASH_M))


def question(road: list[tuple[float, float]] = ROAD, **more: Any) -> dict[str, Any]:
    """The points of a camera on a pole, as the page sends them."""
    points = [
        {"image": [float(u), float(v)], "road": list(place)}
        for (u, v), place in zip(project(road), road, strict=True)
    ]
    return {"points": points, "lines": [], "segments": [SEGMENT], "terms": None, **more}


@pytest.fixture
def session(tmp_path: Path) -> Session:
    """A session on a grey picture."""
    view = tmp_path / "view.png"
    cv2.imwrite(str(view), np.full((720, 1280, 3), 100, dtype=np.uint8))
    out = tmp_path / "camera.toml"
    return Session(record(str(view)), view, out, BUILTIN_MODEL, None, None)


@pytest.fixture
def server(session: Session) -> Iterator[PageServer]:
    """Its page."""
    with PageServer(session) as running:
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield running
        running.shutdown()
        thread.join()


def asked(server: PageServer, what: str, content: object, **headers: str) -> tuple[int, Any]:
    """Status and answer of a question."""
    request = urllib.request.Request(
        f"http://127.0.0.1:{server.server_port}/{what}",
        json.dumps(content).encode(),
        {"X-Key": server.key, **{name.replace("_", "-"): text for name, text in headers.items()}},
    )
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def test_points_are_fitted_and_saved_as_by_the_command_line(
    session: Session, server: PageServer
) -> None:
    """Misses, grid, horizon and errors come back; the file that is saved loads."""
    status, answer = asked(server, "fit", question())
    assert status == 200
    assert answer["rms_px"] < 0.01
    assert answer["terms"] == []
    assert [end["end"] for end in answer["ends"]] == ["near", "far"]
    assert 0 < answer["ends"][0]["speed_error"] < 0.03
    # The camera looks 0.2 rad down: the horizon lies 1000 tan 0.2 px over the middle.
    rows = [place[1] for place in answer["horizon"] if place]
    assert rows == pytest.approx([360 - 1000 * np.tan(0.2)] * len(rows), abs=3)
    along = next(line for line in answer["grid"] if line["label"] == "x 50 m")
    low, high = (along["line"][i] for i in (0, -1))
    edge = project([[50.0, -8 - 0.15 * 16], [50.0, 8 + 0.15 * 16]])
    assert np.array([low, high]) == pytest.approx(edge, abs=0.1)
    moved = question(live=True, fit=answer["fit"])
    moved["points"][2]["image"][1] += 3
    _, live = asked(server, "fit", moved)
    assert live["live"]
    assert live["points"][2]["miss"] > 0.5
    ends = project([[40.0, 2.0], [65.0, 2.0]]).tolist()
    length = {"fit": answer["fit"], "ends": ends}
    assert asked(server, "measure", length)[1]["metres"] == pytest.approx(25, abs=0.01)
    assert "written" in asked(server, "save", question())[1]["saved"]
    camera = load_camera(Path(session.begin()["out"]))
    assert camera.to_road(project([[50.0, 3.0]])) == pytest.approx(
        np.array([[50.0, 3.0]]), abs=0.01
    )


def test_masks_are_kept_and_their_picture_is_grey(tmp_path: Path) -> None:
    """Masks of a points file stay when the camera is calibrated anew without them; the reference
    picture of a camera is written without what they hide, and one over the road is refused.
    """
    out = tmp_path / "camera.toml"
    bright = np.full((720, 1280, 3), 200, dtype=np.uint8)
    mask = ((10.0, 10.0), (200.0, 10.0), (200.0, 90.0), (10.0, 90.0))
    start = PointsSettings.model_validate({**question(), "masks": [mask]})
    Session(Recording(bright, (), ()), None, out, BUILTIN_MODEL, start, None).save(question())
    Session(Recording(bright, (), ()), None, out, BUILTIN_MODEL, None, None).save(question())
    assert [each.tolist() for each in load_camera(out).masks] == [[list(pair) for pair in mask]]
    reference = cv2.imread(str(tmp_path / "camera-reference.png"))
    assert (reference[20:80, 20:190] == 114).all()
    assert (reference[100:] == 200).all()
    assert (bright == 200).all()
    over = project([[30.0, 2.0], [50.0, 2.0], [50.0, 5.0]]).tolist()
    bad = PointsSettings.model_validate({**question(), "masks": [over]})
    session = Session(Recording(bright, (), ()), None, out, BUILTIN_MODEL, bad, None)
    with pytest.raises(InputError, match="covers watched road"):
        session.save(question())


def test_a_points_file_keeps_its_name_and_terms_and_is_for_its_picture(tmp_path: Path) -> None:
    """The page begins with all of it; another picture's points are refused at once."""
    view, out = tmp_path / "view.png", tmp_path / "camera.toml"
    cv2.imwrite(str(view), np.full((720, 1280, 3), 100, dtype=np.uint8))
    content = {**question(), "name": "mast 7", "terms": [], "image": {"width": 1280, "height": 720}}
    start = PointsSettings.model_validate(content)
    session = Session(record(str(view)), view, out, BUILTIN_MODEL, start, None)
    assert session.begin()["terms"] == []
    session.save(question())
    assert load_camera(out).name == "mast 7"
    other = PointsSettings.model_validate({**content, "image": {"width": 640, "height": 360}})
    with pytest.raises(InputError, match="is for 640×360 px"):
        Session(record(str(view)), view, out, BUILTIN_MODEL, other, None)


@pytest.mark.slow
def test_a_length_on_a_bend_is_that_between_the_places(session: Session) -> None:
    """Two places 40 m of stations apart, 10 m inside a bend of 150 m: the chord between them."""
    bend = SCENES["bend of 150 m to the left"]
    places = np.array([(x, y) for x in (18.0, 29.0, 42.0, 58.0, 78.0, 90.0) for y in (-3.5, 3.5)])
    seen = zip(bend.to_image(places).tolist(), places.tolist(), strict=True)
    given = {"points": [{"image": image, "road": road} for image, road in seen], "terms": ["arc"]}
    number = session.fit(given)["fit"]
    ends = bend.to_image([[30.0, 10.0], [70.0, 10.0]]).tolist()
    chord = 2 * (150 - 10) * np.sin(40 / 150 / 2)
    assert session.measure({"fit": number, "ends": ends})["metres"] == pytest.approx(
        chord, rel=1e-3
    )


def test_a_point_far_off_draws_no_more_grid(session: Session) -> None:
    """Among map coordinates one at the origin is left out: the grid is that of the others."""
    given = question()
    for point in given["points"]:
        point["road"] = [point["road"][0] + 5e5, point["road"][1] + 5.5e6]
    spare = {"image": [640.0, 500.0], "road": [0.0, 0.0]}
    given = {**given, "segments": [], "points": [*given["points"], spare]}
    answer = session.fit(given)
    assert not answer["points"][-1]["used"]
    assert len(answer["grid"]) < 80


@pytest.mark.slow
def test_one_row_of_dashes_and_two_edges_can_be_dragged(session: Session) -> None:
    """The lines hold the width while a point moves, as they do when it has moved."""
    sag = SCENES["sag"]
    row = [(x, 0.0) for x in (18.0, 27.0, 36.0, 45.0, 54.0, 63.0, 72.0, 81.0, 90.0)]
    seen = sag.to_image(row).tolist()
    points = [{"image": at, "road": list(xy)} for at, xy in zip(seen, row, strict=True)]
    lines = [
        {"offset": y, "image": sag.to_image([(x, y) for x in (20.0, 35.0, 50.0, 85.0)]).tolist()}
        for y in (-3.5, 3.5)
    ]
    given = {"points": points, "lines": lines, "terms": ["crest"]}
    fitted = session.fit(given)
    assert fitted["rms_px"] < 0.1
    points[4]["image"][1] += 1.0
    live = session.fit({**given, "live": True, "fit": fitted["fit"]})
    assert live["live"]
    assert 0.2 < live["points"][4]["miss"] < 2.0


def test_an_answer_is_for_the_fit_that_was_asked_about(session: Session) -> None:
    """After another fit, or one that failed, a length of the one before is refused."""
    ends = project([[40.0, 2.0], [65.0, 2.0]]).tolist()
    first, second = (session.fit(question())["fit"] for _ in range(2))
    assert "calibrate first" in session.measure({"fit": first, "ends": ends})["problem"]
    assert "metres" in session.measure({"fit": second, "ends": ends})
    wrong = question()
    wrong["points"][0]["image"] = [-5, 0]
    with pytest.raises(InputError, match="outside"):
        session.fit(wrong)
    assert "problem" in session.measure({"fit": second, "ends": ends})


def test_a_detector_that_fails_is_told(
    session: Session, clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever its fault, the page hears of it instead of asking for ever."""

    def fault(*_: object) -> None:
        raise RuntimeError("no memory")

    monkeypatch.setattr("edge_daemon.calibration.session.detect", fault)
    out = Path(session.begin()["out"])
    moving = Session(record(str(clip)), None, out, BUILTIN_MODEL, None, None)
    deadline = time.monotonic() + 60
    answer = moving.guess({})
    while "problem" not in answer and time.monotonic() < deadline:
        time.sleep(0.01)
        answer = moving.guess({})
    assert answer == {"problem": "the detector failed: no memory"}


def test_segments_of_the_file_before_are_shown_and_can_be_deleted(session: Session) -> None:
    """What the page begins with is what the file has; what it saves is what it shows."""
    session.save(question())
    out = Path(session.begin()["out"])
    again = Session(record(str(out.with_name("view.png"))), None, out, BUILTIN_MODEL, None, None)
    assert [segment["id"] for segment in again.begin()["segments"]] == ["approach"]
    assert "no segments" in again.save(question(segments=[]))["saved"]
    assert read_points(out).segments == ()


def test_what_is_wrong_is_one_line(server: PageServer) -> None:
    """Too few points, contradictions, keys that no points file has, a picture without traffic."""
    few = question()
    few["points"] = few["points"][:3]
    assert "1 more point needed" in asked(server, "fit", few)[1]["problem"]
    wrong = question()
    del wrong["points"][7:]
    for i in (1, 4):
        wrong["points"][i]["road"][1] += 30 + 9 * i
    assert asked(server, "fit", wrong)[1]["problem"].startswith("points: points: ")
    assert "problem" in asked(server, "save", wrong)[1]
    odd = question()
    odd["points"][0]["colour"] = "red"
    assert "unknown key" in asked(server, "fit", odd)[1]["problem"]
    assert "calibrate first" in asked(server, "measure", {"ends": []})[1]["problem"]
    assert "single picture" in asked(server, "traffic", {})[1]["problem"]
    assert asked(server, "fit", [1])[0] == 400
    assert asked(server, "reboot", {})[0] == 400


def test_what_cannot_be_measured_is_answered(server: PageServer) -> None:
    """A far end that a click puts beyond the horizon has no error: null, with a warning."""
    near = [(20.0, -2.0), (20.0, 2.0), (26.0, -2.0), (26.0, 2.0)]
    long = {**SEGMENT, "polygon": [[20, 0], [3000, 0], [3000, 7], [20, 7]]}
    status, answer = asked(server, "fit", question(near, segments=[long]))
    assert status == 200
    assert answer["ends"][1]["speed_error"] is None
    assert any("cannot be measured" in said for said in answer["warnings"])


def test_a_fault_is_answered_too(server: PageServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """What nobody thought of is one line, not a connection that ends."""

    def fault(_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(server.session, "snap", fault)
    status, answer = asked(server, "snap", {})
    assert status == 500
    assert "log" in answer["problem"]


def test_only_this_machine_and_who_has_the_key_are_answered(server: PageServer) -> None:
    """Neither a wrong key nor another site's name for this address gets anything."""
    assert server.server_address[0] == "127.0.0.1"
    assert asked(server, "fit", question(), X_Key="guessed")[0] == 403
    assert asked(server, "fit", question(), Host="evil.example")[0] == 403
    with pytest.raises(urllib.error.HTTPError, match="403"):
        urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/picture.png")
    with urllib.request.urlopen(server.url) as page:
        assert "default-src 'none'" in page.headers["Content-Security-Policy"]


def test_a_click_snaps_to_the_corner_to_a_quarter_of_a_pixel() -> None:
    """A dash drawn eightfold and reduced; where nothing is, a click stays."""
    large = np.full((8 * 80, 8 * 80, 3), 90, dtype=np.uint8)
    corners = np.array([(30.4, 20.2), (45.1, 20.2), (45.1, 55.7), (30.4, 55.7)])
    cv2.fillPoly(large, [(8 * corners).round().astype(np.int32)], (220, 220, 220))
    picture = np.asarray(cv2.resize(large, (80, 80), interpolation=cv2.INTER_AREA), np.uint8)
    for corner in corners:
        found = snap(picture, corner[0] + 1.2, corner[1] - 0.9)
        assert found == pytest.approx(corner, abs=0.25)
    assert snap(picture, 15.0, 15.0) == (15.0, 15.0)
    assert snap(picture, 1.0, 79.0) == (1.0, 79.0)


@pytest.mark.long
def test_a_first_guess_comes_from_movement_and_sizes(camera: Camera) -> None:
    """Cars of 4.1 to 4.7 m drive both ways: lengths are met within the error that is stated."""
    rng = np.random.default_rng(3)
    ends = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0.1, 1)])
    frames: list[list[list[float]]] = [[] for _ in range(60)]
    assert camera.pose is not None
    for car in range(16):
        size = np.array([4.4, 1.8, 1.5]) * (1 + rng.normal(0, 0.05))
        lane = (-5.2, -1.8, 1.8, 5.2)[car % 4]
        begin, speed = rng.uniform(25, 90), rng.uniform(10, 14) * (1 if lane < 0 else -1)
        for i, frame in enumerate(frames):
            x = begin + speed * i / 15
            if not 18 < x < 110:
                continue
            seen = camera.pose.project(ends * size + (x, lane, 0))
            low, high = seen.min(axis=0), seen.max(axis=0)
            frame.append([*(low + rng.normal(0, 0.7, 2)), *(high + rng.normal(0, 0.7, 2))])
    detections = [
        Detections(
            np.array(frame, dtype=np.float32).reshape(-1, 4),
            np.full(len(frame), 0.9, dtype=np.float32),
            np.zeros(len(frame), dtype=np.int64),
        )
        for frame in frames
    ]
    found = guess(detections, camera.size)
    assert found is not None
    assert found.relative_error < 0.2
    pixels = np.array([point.image for point in found.points])
    guessed = np.array([point.road for point in found.points])
    true = camera.to_road(pixels)
    share = np.ptp(guessed[:, 0]) / np.ptp(true[:, 0])
    assert abs(share - 1) < 2.5 * found.relative_error
    assert guess(detections[:3], camera.size) is None


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """Three seconds of noise through which a white bar drives."""
    clip = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"MJPG"), 10, (160, 96))
    rng = np.random.default_rng(0)
    for i in range(30):
        frame = rng.integers(60, 70, (96, 160, 3), dtype=np.uint8)
        frame[40:60, 4 * i : 4 * i + 20] = 250
        writer.write(frame)
    writer.release()
    return clip


def test_a_clip_gives_its_median_and_a_file_that_is_none_is_refused(
    clip: Path, tmp_path: Path
) -> None:
    """What drives through is not in the median; times rise."""
    recording = record(str(clip))
    assert len(recording.times_s) > 20
    assert (np.diff(recording.times_s) > 0).all()
    assert recording.picture.max() < 110
    with pytest.raises(InputError):
        record(str(tmp_path / "none.mp4"))
    with pytest.raises(InputError):
        record("ftp://camera")


def _click(page: Any, at_px: Any) -> None:
    """Click a place of the picture, zoomed in so that a screen pixel is a third of its own."""
    u, v = (float(c) for c in at_px)
    x, y = page.evaluate(
        "([u, v]) => { view.zoom = 3; view.u = u - canvas.clientWidth / 6;"
        " view.v = v - canvas.clientHeight / 6; draw();"
        " const box = canvas.getBoundingClientRect(), [x, y] = toScreen([u, v]);"
        " return [x + box.left, y + box.top]; }",
        [u, v],
    )
    page.mouse.click(round(x), round(y))


def _settled(page: Any) -> None:
    for _ in range(600):
        if page.evaluate("!busy && again === null && result !== null && !result.live"):
            page.wait_for_timeout(150)
            if page.evaluate("!busy && again === null && !result.live"):
                return
        page.wait_for_timeout(100)
    raise AssertionError(page.inner_text("#result"))


@pytest.mark.nightly
def test_a_rendered_clip_is_calibrated_from_its_dashes_by_clicks_alone(
    browser: Any,
    street_clips: dict[str, Path],
    tmp_path: Path,
    figure: Callable[[str], None],
) -> None:
    """Dashes clicked; a second length to 2 %, the speeds of its traffic to 3 % of truth."""
    folder = street_clips["stable"]
    true = load_camera(folder / "camera.toml")
    clip = next(folder.glob("*.mp4"))
    out = tmp_path / "camera.toml"
    recording = record(str(clip))
    session = Session(recording, None, out, BUILTIN_MODEL, None, "north")
    with PageServer(session) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(server.url)
        page.wait_for_selector("#problem:not(:empty)")
        _type_coordinates_in_a_row(page)
        clicks = _rows_of_dashes(page, true)
        _undo_and_click_again(page)
        _settled(page)
        rms = page.evaluate("result.rms_px")
        page.click("[data-mode=check]")
        first, last, y = 30.0, 57.0, _dash_rows(true)[0]
        ends = true.to_image([[first, y], [last, y]])
        for place in ends:
            _click(page, place)
            page.wait_for_timeout(300)
        page.wait_for_selector("#checked")
        metres = page.evaluate("checkMetres")
        page.click("[data-mode=segment]")
        segment = true.segments[0]
        low, high = segment.polygon_m.min(axis=0), segment.polygon_m.max(axis=0)
        for place in true.to_image([low, high]):
            _click(page, place)
            page.wait_for_timeout(300)
        _settled(page)
        page.click("#traffic")
        for _ in range(1200):
            page.wait_for_timeout(250)
            if page.is_enabled("#traffic"):
                break
        speeds = page.evaluate("vehicles.map((v) => v.kmh)")
        page.click("#save")
        page.wait_for_selector("#saved.good")
        assert errors == []
        server.shutdown()
        thread.join()
    camera = load_camera(out)
    assert camera.name == "north"
    assert abs(metres / (last - first) - 1) < 0.02
    shown, driven = float(np.mean(speeds)), _mean_kmh(folder / "truth.csv", recording)
    assert abs(shown / driven - 1) < 0.03
    figure(
        f"{clicks} clicks, reprojection {rms:.2f} px, 27 m measured as {metres:.2f} m, "
        f"mean speed {shown:.1f} km/h, truth {driven:.1f} km/h"
    )


def _wait_for_points(page: Any, count: int) -> None:
    for _ in range(100):
        if page.evaluate("sheet.points.length") == count:
            return
        page.wait_for_timeout(50)


def _type_coordinates_in_a_row(page: Any) -> None:
    """A point is clicked, x typed, Tab, y typed, Tab: both are taken; then all is undone."""
    _click(page, (640.0, 500.0))
    page.wait_for_selector("[aria-label='x of point 1']:focus")
    page.keyboard.type("12.5")
    assert page.evaluate("asked().points") == []
    page.keyboard.press("Tab")
    page.keyboard.type("3")
    page.keyboard.press("Tab")
    assert page.evaluate("sheet.points.map((p) => p.road)") == [[12.5, 3]]
    assert page.evaluate("mode") == "point"
    page.click("[aria-label='x of point 1']", click_count=3)
    page.keyboard.type("13")
    page.click("[aria-label='y of point 1']", click_count=3)
    page.keyboard.type("4")
    page.click("[aria-label='Delete point 1']")
    assert page.evaluate("sheet.points.length") == 0
    page.click("#undo")
    assert page.evaluate("sheet.points.map((p) => p.road)") == [[13, 4]]
    for _ in range(5):
        page.click("#undo")
    assert page.evaluate("sheet.points.length") == 0
    page.click("#view", button="right", position={"x": 300, "y": 300})
    page.wait_for_timeout(300)
    assert page.evaluate("sheet.points.length") == 0


def _undo_and_click_again(page: Any) -> None:
    """The last dash is undone, and deleted: clicked again, it has the same place each time."""
    (last,) = page.evaluate("sheet.points.slice(-1)")
    count = page.evaluate("sheet.points.length")
    for how in ("#undo", f"[aria-label='Delete point {count}']"):
        page.click(how)
        _click(page, last["image"])
        _wait_for_points(page, count)
        assert page.evaluate("sheet.points.at(-1).road") == last["road"]


def _dash_rows(true: Camera) -> list[float]:
    """y of the lines of dashes: the middles of the carriageways."""
    return [float(s.polygon_m[:, 1].mean()) for s in true.segments]


def _rows_of_dashes(page: Any, true: Camera) -> int:
    """Click every dash's beginning between 18 and 90 m of each row, with the page's own preset."""
    clicks = 0
    page.click("[data-mode=dashes]")
    page.select_option("#preset", str(DASHES))
    rows = _dash_rows(true)
    if len(rows) == 1:  # the other carriageway's dashes lie as far on the other side
        rows.append(-rows[0])
    for y in rows:
        page.fill("[aria-label='x of the next click']", "18")
        page.press("[aria-label='x of the next click']", "Tab")
        page.fill("[aria-label='y of this row']", str(y))
        page.press("[aria-label='y of this row']", "Tab")
        for x in np.arange(18.0, 91.0, PERIOD_M):
            (place,) = true.to_image([[x, y]])
            before = page.evaluate("sheet.points.length")
            _click(page, place)
            _wait_for_points(page, before + 1)
            clicks += 1
    return clicks


def _mean_kmh(truth: Path, recording: Recording) -> float:
    """Mean over the vehicles of their true mean speeds while recorded."""
    speeds = defaultdict(list)
    with truth.open() as file:
        for line in csv.DictReader(file):
            seen = 18 <= float(line["x_m"]) <= 90 and float(line["visible_fraction"]) > 0.4
            if seen and float(line["time_s"]) <= recording.times_s[-1]:
                speeds[line["vehicle_id"]].append(3.6 * float(line["speed_mps"]))
    return float(np.mean([np.mean(of_one) for of_one in speeds.values() if len(of_one) > 15]))
