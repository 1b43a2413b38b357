"""The judges of a camera's picture, on rendered traffic and on an empty road."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.camera import hide, load_camera
from edge_daemon.detection import Detections
from edge_daemon.frame import Frame
from edge_daemon.settings import WatchSettings
from edge_daemon.watch import Watch, read_reference
from edge_daemon.watch.debounce import Debounce
from edge_daemon.watch.faults.camera_moved import CameraMovedJudge
from edge_daemon.watch.faults.clock_jump import ClockJumpJudge
from edge_daemon.watch.sample import Sample, detail_grey
from edge_daemon.watch.view import View
from slipstream.errors import InputError
from slipstream.messages import CameraFault

from .roads import EVERY_S, Change, Picture, Road, at, shifted, warped

FAULT_AT_S = 8.0


def changes(watch: Watch, pictures: Iterator[Picture]) -> list[tuple[float, CameraFault | None]]:
    """When the watch changed its mind, and to what."""
    heard: list[tuple[float, CameraFault | None]] = []
    last: CameraFault | None = None
    for number, picture in enumerate(pictures):
        fault = watch.look(at(number * EVERY_S, picture))
        if fault != last:
            heard.append((number * EVERY_S, fault))
            last = fault
    return heard


def blurred(picture: Picture, _: float) -> Picture:
    """Out of focus."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 8), dtype=np.uint8)


def half_grey(picture: Picture) -> Picture:
    """The decoder lost the lower half."""
    picture = picture.copy()
    picture[360:] = 128
    return picture


def streaked(picture: Picture) -> Picture:
    """The decoder repeated one row downwards."""
    picture = picture.copy()
    picture[300:] = picture[300]
    return picture


def blocks(picture: Picture) -> Picture:
    """Every third macroblock is off by up to 80 levels."""
    chance = np.random.default_rng(1)
    off = chance.integers(-80, 80, (45, 80, 3)) * (chance.random((45, 80, 1)) < 0.33)
    wide = np.repeat(np.repeat(off, 16, axis=0), 16, axis=1)
    return np.clip(picture + wide, 0, 255).astype(np.uint8)


PICTURE_FAULTS: dict[str, tuple[Change, CameraFault]] = {
    "black": (lambda p, _: np.zeros_like(p), "dark"),
    "white": (lambda p, _: np.full_like(p, 255), "bright"),
    "out of focus": (blurred, "obscured"),
    "covered": (lambda p, _: np.full_like(p, 90), "obscured"),
    "turned by 5 px": (shifted(5), "camera_moved"),
    "sagged by 5 px": (shifted(0, 5), "camera_moved"),
    "turned by 300 px": (shifted(300), "camera_moved"),
    "hung upside down": (lambda p, _: np.ascontiguousarray(p[::-1, ::-1]), "camera_moved"),
}


@pytest.mark.long
@pytest.mark.parametrize("name", list(PICTURE_FAULTS))
def test_a_fault_of_the_picture_is_noticed_and_ends_by_itself(road: Road, name: str) -> None:
    """Within ten seconds, by its name, and gone ten seconds after the picture is good again."""
    change, expected = PICTURE_FAULTS[name]
    good_again_s = FAULT_AT_S + 8.0

    def pictures() -> Iterator[Picture]:
        for number in range(round((good_again_s + 8.0) / EVERY_S)):
            faulty = FAULT_AT_S <= number * EVERY_S < good_again_s
            yield road.seen(number, change if faulty else None)

    (began_s, first), (ended_s, last) = changes(Watch(road.camera, WatchSettings()), pictures())
    assert (first, last) == (expected, None)
    assert FAULT_AT_S <= began_s <= FAULT_AT_S + 6.0
    assert good_again_s <= ended_s <= good_again_s + 6.0


@pytest.mark.parametrize(
    "damage", [streaked, blocks, pytest.param(half_grey, marks=pytest.mark.long)]
)
def test_damaged_pictures_are_corrupt(road: Road, damage: Callable[[Picture], Picture]) -> None:
    """Lost parts, streaks and wrong macroblocks are told within two seconds; one picture is not."""
    watch = Watch(road.camera, WatchSettings())
    assert watch.look(at(0.0, damage(road.seen(0)))) is None
    later = [
        watch.look(at(EVERY_S * n, damage(road.seen(n)) if n >= 20 else road.seen(n)))
        for n in range(1, 30)
    ]
    assert later[:19] == [None] * 19
    assert later[-1] == "corrupt"


def test_a_repeated_picture_is_frozen(road: Road) -> None:
    """Also where a clock drawn into the picture runs on; noise ends it."""

    def pictures() -> Iterator[Picture]:
        still = road.seen(40)
        for number in range(110):
            if 40 <= number < 80:
                with_clock = still.copy()
                cv2.putText(with_clock, f"{number}", (20, 60), 0, 2.0, (255, 255, 255), 3)
                yield with_clock
            else:
                yield road.seen(number)

    (began_s, first), (ended_s, last) = changes(Watch(road.camera, WatchSettings()), pictures())
    assert (first, last) == ("frozen", None)
    assert 12.0 <= began_s <= 15.0
    assert 16.0 <= ended_s <= 20.0


def test_a_repeated_picture_is_frozen_through_an_encoder(road: Road, tmp_path: Path) -> None:
    """An encoder makes key frames and rounding of it, as MPEG-4 does here; it is frozen still."""
    path = tmp_path / "still.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 1 / EVERY_S, (1280, 720))
    still = road.seen(0)
    for _ in range(45):
        writer.write(still)
    writer.release()
    capture = cv2.VideoCapture(str(path))
    pictures = iter([np.asarray(capture.read()[1], dtype=np.uint8) for _ in range(45)])
    ((began_s, fault),) = changes(Watch(road.camera, WatchSettings()), pictures)
    assert fault == "frozen"
    assert began_s <= 8.0


@pytest.mark.parametrize("scenario", ["stable", pytest.param("turbulent", marks=pytest.mark.long)])
def test_ordinary_traffic_is_no_fault(street_clips: dict[str, Path], scenario: str) -> None:
    """Compressed video with passing, covering and standing vehicles: nothing to complain of."""
    folder = street_clips[scenario]
    watch = Watch(load_camera(folder / "camera.toml"), WatchSettings())
    capture = cv2.VideoCapture(str(folder / "video.mp4"))
    faults = set()
    for number in range(14 * 15):
        ok, picture = capture.read()
        assert ok
        faults.add(watch.look(at(number / 15, np.asarray(picture, dtype=np.uint8))))
    assert faults == {None}


@pytest.mark.long
def test_an_empty_road_at_dusk_is_no_fault(road: Road) -> None:
    """30 s of nothing but noise while the light falls to a third."""

    def dusk(picture: Picture, time_s: float) -> Picture:
        return np.asarray(cv2.convertScaleAbs(picture, alpha=1 - time_s / 45), dtype=np.uint8)

    pictures = (road.seen(number, dusk) for number in range(150))
    assert changes(Watch(road.camera, WatchSettings()), pictures) == []


@pytest.mark.long
def test_gusts_and_trembling_are_no_fault(road: Road) -> None:
    """The pole shakes by a pixel all the time, and by a dozen for a moment now and then."""
    chance = np.random.default_rng(5)

    def shaken(picture: Picture, time_s: float) -> Picture:
        gust = 12.0 if time_s % 5 < 0.3 else 0.0
        right, down = chance.normal(0, 1, 2)
        return shifted(right + gust, down)(picture, time_s)

    pictures = (road.seen(number, shaken) for number in range(75))
    assert changes(Watch(road.camera, WatchSettings()), pictures) == []


def test_a_view_without_anything_to_recognise_is_said(
    road: Road, caplog: pytest.LogCaptureFixture
) -> None:
    """Whether the camera moves cannot be told then, and the log says so once."""
    Watch(road.camera, WatchSettings(), road.picture)
    assert "nothing to recognise" not in caplog.text
    Watch(road.camera, WatchSettings(), np.full_like(road.picture, 90))
    assert caplog.text.count("nothing to recognise") == 1


@pytest.mark.long
def test_a_reference_picture_tells_a_camera_that_was_turned_while_off(road: Road) -> None:
    """Without one, the first seconds are taken for the calibrated view."""
    turned = [road.seen(number, shifted(8)) for number in range(40)]
    assert changes(Watch(road.camera, WatchSettings()), iter(turned)) == []
    watch = Watch(road.camera, WatchSettings(), road.picture)
    ((began_s, fault),) = changes(watch, iter(turned))
    assert fault == "camera_moved"
    assert began_s <= 6.0


def test_a_reference_must_be_a_picture_of_the_calibrated_size(
    street_clips: dict[str, Path], tmp_path: Path, road: Road
) -> None:
    """Else one line says which file, and why."""
    calibration = tmp_path / "camera.toml"
    text = (street_clips["stable"] / "camera.toml").read_text()
    calibration.write_text(text.replace("[image]", 'reference = "view.png"\n[image]', 1))
    view = tmp_path / "view.png"
    header = b"IHDR" + struct.pack(">IIBBBBB", 2**31 - 1, 2**31 - 1, 8, 2, 0, 0, 0)
    forged = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    for content in (b"no picture", b"\x89PNG\r\n\x1a\n" + forged):
        view.write_bytes(content)
        with pytest.raises(InputError, match=r"view\.png: not a picture"):
            read_reference(load_camera(calibration))
    cv2.imwrite(str(view), road.picture[::2, ::2])
    with pytest.raises(InputError, match=r"640×360.*1280×720"):
        read_reference(load_camera(calibration))
    cv2.imwrite(str(view), road.picture)
    read = read_reference(load_camera(calibration))
    assert read is not None
    assert np.array_equal(read, road.picture)


def test_a_view_s_motion_is_measured_to_a_tenth_of_a_pixel(road: Road) -> None:
    """Shift and turn, in the full picture; darkness does not matter."""
    view = View(road.camera, road.seen(0))
    turn = cv2.getRotationMatrix2D((640, 360), 0.1, 1.0)
    turn[:, 2] += (2.5, -1.5)
    view.measure(detail_grey(road.seen(1, warped(turn)) // 3))
    assert view.motion is not None
    places = np.array([[300.0, 500.0], [640.0, 360.0], [1000.0, 300.0]])
    moved = cv2.transform(places[None], turn)[0] - places
    assert view.motion.at(places) == pytest.approx(moved, abs=0.1)


def test_the_outline_of_a_mask_hides_no_motion(road: Road) -> None:
    """A third of the picture is masked, with corners that stay where they are: the camera's own
    movement is measured by what is beside them.
    """
    mask = np.array([[20.0, 20.0], [500.0, 20.0], [500.0, 200.0], [260.0, 90.0], [20.0, 200.0]])
    camera = copy(road.camera)
    camera.masks = (mask, np.add(mask, (700.0, 0.0)))

    def seen(number: int, right: float, down: float) -> Picture:
        picture = road.seen(number, shifted(right, down))
        hide(picture, camera.masks)
        return picture

    view = View(camera, seen(0, 0.0, 0.0))
    view.measure(detail_grey(seen(1, 3.0, -2.0)))
    assert view.motion is not None
    assert view.motion.at(np.array([[640.0, 360.0]])) == pytest.approx(
        np.array([[3.0, -2.0]]), abs=0.2
    )
    assert view.found_share > 0.9


@pytest.mark.long
def test_shaking_that_is_allowed_is_taken_out_of_boxes(road: Road) -> None:
    """Once the first seconds are known, what stands is where it stood, to a fifth of a pixel, also
    where the first picture was off.
    """
    watch = Watch(road.camera, WatchSettings())
    chance = np.random.default_rng(3)
    box = np.array([[600.0, 400.0, 680.0, 460.0]], np.float32)
    found = []
    for number in range(120):
        right, down = (2.5, -2.5) if number == 0 else chance.normal(0, 2, 2)
        picture = road.seen(number, shifted(right, down))
        frame = replace(at(number * EVERY_S / 3, picture), repeated=False)
        shaken = box + np.array([right, down, right, down], np.float32)
        seen = Detections(shaken, np.ones(1, np.float32), np.zeros(1, np.int64))
        assert watch.look(frame, seen.boxes) is None
        found.append(watch.steady(seen).boxes[0])
    late = np.array(found[75:])
    assert late.std(axis=0).max() < 0.2
    assert np.abs(late.mean(axis=0) - box).max() < 0.8


@pytest.mark.slow
def test_pictures_of_any_size_can_be_watched(tmp_path: Path) -> None:
    """Odd and small ones too."""
    chance = np.random.default_rng(0)
    for width, height in ((641, 359), (96, 64), (3840, 2160)):
        points = [(0.1, 0.9), (0.9, 0.9), (0.6, 0.3), (0.4, 0.3)]
        road_m = [(0, 0), (10, 0), (10, 60), (0, 60)]
        lines = ["schema = 1", 'name = "a"', "[image]", f"width = {width}", f"height = {height}"]
        for (u, v), (x, y) in zip(points, road_m, strict=True):
            lines += [
                "[[points]]",
                f"image = [{u * width}, {v * height}]",
                f"road = [{x}.0, {y}.0]",
            ]
        lines += ["[[segments]]", 'id = "s"', "direction = [0.0, 1.0]"]
        lines += ["polygon = [[1.0, 1.0], [9.0, 1.0], [9.0, 50.0], [1.0, 50.0]]"]
        (tmp_path / "camera.toml").write_text("\n".join(lines))
        watch = Watch(load_camera(tmp_path / "camera.toml"), WatchSettings())
        pictures = chance.integers(0, 255, (3, height, width, 3), dtype=np.uint8)
        for number in range(9):
            watch.look(at(number * EVERY_S, pictures[number % 3]))


def test_a_wall_clock_that_steps_is_told_once(road: Road) -> None:
    """A step counts; slewing by 500 ppm does not, and neither does one late thread."""
    judge = ClockJumpJudge()
    picture = road.picture

    def look(time_s: float, wall_s: float, *, jump: bool = False) -> bool:
        frame = Frame(picture, time_s, round(1e18 + 1e9 * wall_s), time_s, clock_jump=jump)
        return judge.look(Sample(frame, 1))

    assert not any(look(t, 1.0005 * t) for t in range(2000))
    assert not look(2000.0, 2001.7)
    assert not look(2000.1, 2001.1)
    assert [look(2000.2 + n / 10, n / 10) for n in range(4)] == [False, True, False, False]
    assert look(2001.0, 0.8, jump=True)


def test_media_time_that_leaps_is_told(road: Road) -> None:
    """Back, or much further than time has passed; a pause of a camera is no leap."""
    judge = ClockJumpJudge()

    def look(media_s: float, passed_s: float) -> bool:
        frame = Frame(road.picture, media_s, round(1e9 * passed_s), passed_s)
        return judge.look(Sample(frame, 1))

    assert not look(0.0, 0.0)
    assert not look(60.0, 60.0)
    assert look(120.0, 60.1)
    assert look(119.0, 60.2)
    assert not look(119.1, 60.3)


def test_a_clock_jump_is_a_fault_for_a_while(road: Road) -> None:
    """It begins at once and ends `clear_after_s` later."""
    watch = Watch(road.camera, WatchSettings())
    faults = []
    for number in range(60):
        frame = at(number * EVERY_S, road.seen(number))
        jump = number == 20
        faults.append(
            watch.look(
                Frame(frame.image, frame.media_time_s, 0, frame.captured_s, clock_jump=jump)
                if jump
                else frame
            )
        )
    assert faults[19] is None
    assert set(faults[20:30]) == {"clock_jump"}
    assert faults[-1] is None


def test_no_picture_for_a_while_is_stale(road: Road) -> None:
    """Shorter pauses keep what was said last."""
    watch = Watch(road.camera, WatchSettings())
    watch.look(at(0.0, road.seen(0)))
    assert watch.absent(1.0) is None
    assert watch.absent(3.0) == "stale"


def test_evidence_must_last_to_begin_and_be_gone_to_end() -> None:
    """A flicker neither begins nor ends a fault."""
    debounce = Debounce(after_s=1.0, clear_s=2.0)
    seen = {0.0, 0.5, 1.5, 2.0, 2.5, 3.0, 4.0}
    active = [t / 2 for t in range(20) if debounce.update(t / 2, t / 2 in seen)]
    assert active == [2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5]


@pytest.mark.long
def test_a_view_that_changes_with_the_hours_is_followed_but_a_turn_is_not(road: Road) -> None:
    """Over 50 minutes the scene becomes another; the camera is then turned by 8 px."""
    other = np.ascontiguousarray(road.picture[::-1, ::-1])
    view = View(road.camera, road.picture)
    judge = CameraMovedJudge(view, 4.0, 6.0, 20.0)

    def moved(judge: CameraMovedJudge, time_s: float, share: float, aside: int = 0) -> bool:
        mixed = cv2.addWeighted(other, share, road.picture, 1 - share, 0)
        sample = Sample(at(time_s, np.roll(np.asarray(mixed, np.uint8), aside, axis=1)), 1)
        judge.view.measure(sample.detail)
        return judge.look(sample)

    assert not any(moved(judge, time_s, time_s / 3000) for time_s in range(0, 3000, 5))
    assert not any(moved(judge, time_s, 1.0) for time_s in range(3000, 3400, 5))
    later = [moved(judge, t, 1.0, 8 if t >= 3420 else 0) for t in range(3400, 3460, 5)]
    assert later[-1]
    assert not later[0]
    turned_at_once = CameraMovedJudge(View(road.camera, road.picture), 4.0, 6.0, 20.0)
    assert [moved(turned_at_once, t, 1.0) for t in range(0, 40, 5)][-1]
