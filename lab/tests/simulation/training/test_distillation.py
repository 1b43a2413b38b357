"""Real cameras, a teacher's answers, and the samples that both give."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from edge_daemon.detection import VEHICLE_CLASSES, Detections, builtin_model
from edge_daemon.frame import Image
from slipstream.errors import InputError
from slipstream_lab.simulation.training.__main__ import main as training
from slipstream_lab.simulation.training.card import (
    RealRecord,
    Record,
    StageRecord,
    card_text,
    earlier_stages,
)
from slipstream_lab.simulation.training.distillation import (
    Answer,
    Batches,
    DistilSettings,
    RealCamera,
    RealFigures,
    judge_cameras,
    judging,
    mixed_pictures,
    of_role,
    read_sources,
)
from slipstream_lab.simulation.training.distillation.distil import learning_rate, unknown_to
from slipstream_lab.simulation.training.distillation.samples import cut, side_by_side, worn
from slipstream_lab.simulation.training.distillation.teacher import CocoTeacher, joined
from slipstream_lab.simulation.training.metrics import Boxes, DetectionFigures

SHAPE = (64, 96)
PLACES = 8 * 12 + 4 * 6 + 2 * 3


def write_picture(path: Path, tone: int = 90, labels: str = "") -> None:
    """A grey picture of 200 x 100 with a label file."""
    (path.parent.parent / "labels").mkdir(parents=True, exist_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((100, 200, 3), tone, np.uint8))
    (path.parent.parent / "labels" / path.with_suffix(".txt").name).write_text(labels)


def described(folder: Path, *cameras: str) -> Path:
    """A list of cameras, each of its lines."""
    path = folder / "sources.toml"
    path.write_text("\n".join(f"[[camera]]\n{lines}" for lines in cameras))
    return path


def camera_lines(name: str, role: str, files: str, more: str = "") -> str:
    """The lines of one camera."""
    return (
        f'name = "{name}"\nrole = "{role}"\nfiles = ["{files}"]\n'
        f'source = "example.org"\nlicence = "MIT"\n{more}\n'
    )


def boxes_of(*rows: tuple[float, float, float, float]) -> Boxes:
    """Cars."""
    corners = np.array(rows, dtype=np.float64).reshape(-1, 4)
    return Boxes(corners, np.zeros(len(rows), dtype=np.int64), np.ones(len(rows)))


class OneCar:
    """A teacher that sees a car at the first place of every picture, and counts who asks."""

    def __init__(self) -> None:
        self.asked: list[Image] = []

    def answer(self, fine: Image, detailed: bool) -> Answer:
        """See Teacher."""
        self.asked.append(fine)
        scores = np.zeros((PLACES, len(VEHICLE_CLASSES)), np.float32)
        scores[0, 0] = 0.8
        boxes = np.zeros((PLACES, 4), np.float32)
        boxes[0] = (0, 0, 20, 20)
        return Answer(boxes, scores, (np.zeros((1, 8, 12), np.float16),))


@pytest.fixture
def cameras(tmp_path: Path) -> tuple[RealCamera, ...]:
    """One dark camera to train on, one bright one that is only measured."""
    for number in range(2):
        write_picture(tmp_path / "dark" / "images" / f"{number}.png", 30, "1 0.5 0.5 0.2 0.4\n")
    write_picture(tmp_path / "bright" / "images" / "0.png", 250)
    labels = 'labels = ["person", "car"]'
    sources = described(
        tmp_path,
        camera_lines("dark", "train", "dark/images/*.png", labels),
        camera_lines("bright", "test", "bright/images/*.png", labels),
    )
    return read_sources(tmp_path, sources)


@pytest.fixture
def rendered(tmp_path: Path) -> Path:
    """A rendered set of two pictures."""
    for name in ("a", "b"):
        write_picture(tmp_path / "set" / "images" / "train" / f"{name}.png", 120)
        labels = tmp_path / "set" / "labels" / "train"
        labels.mkdir(parents=True, exist_ok=True)
        rows = (f"0 {x / 10} {y / 10} 0.05 0.1\n" for x in range(1, 10) for y in range(1, 10))
        (labels / f"{name}.txt").write_text("".join(rows))
    return tmp_path / "set"


def settings_of(**changed: int | float) -> DistilSettings:
    """Small samples, four a batch."""
    plain: dict[str, int | float] = {"pictures": 40, "distinct": 3, "batch": 4}
    return DistilSettings(shape=SHAPE, **(plain | changed))  # type: ignore[arg-type]


def test_labels_in_any_order_of_classes_become_boxes(cameras: tuple[RealCamera, ...]) -> None:
    """Each data set numbers its classes in its own way."""
    _, boxes = next(cameras[0].pictures())
    assert boxes is not None
    assert boxes.classes.tolist() == [VEHICLE_CLASSES.index("car")]
    assert boxes.corners[0] == pytest.approx([80, 30, 120, 70])


def test_squeezed_pictures_get_their_shape_back(tmp_path: Path) -> None:
    """Boxes are relative, so they follow."""
    write_picture(tmp_path / "images" / "a.png", labels="0 0.5 0.5 0.5 0.5\n")
    camera = RealCamera("a", (tmp_path / "images/a.png",), "", "", "test", ("car",), aspect=4.0)
    image, boxes = next(camera.pictures())
    assert image.shape == (50, 200, 3)
    assert boxes is not None
    assert boxes.corners[0] == pytest.approx([50, 12.5, 150, 37.5])


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        (camera_lines("a", "learn", "dark/images/*.png"), "no such role"),
        (camera_lines("a", "train", "missing/*.png"), "no file like"),
        (camera_lines("a", "train", "dark/images/*.png", "wight = 2"), "unknown key"),
        (camera_lines("a", "test", "dark/images/*.png"), "no camera to train on"),
        ('name = "a"\nrole = "train"\nfiles = ["x"]\n', "no source"),
    ],
)
def test_a_wrong_list_of_sources_is_refused(
    tmp_path: Path, cameras: tuple[RealCamera, ...], lines: str, fault: str
) -> None:
    """In one line that says what is wrong."""
    with pytest.raises(InputError, match=fault):
        read_sources(tmp_path, described(tmp_path, lines))


def test_a_picture_belongs_to_one_camera(tmp_path: Path, cameras: tuple[RealCamera, ...]) -> None:
    """Else what is learned from would be measured too."""
    both = [camera_lines(n, r, "dark/images/*.png") for n, r in (("a", "train"), ("b", "test"))]
    with pytest.raises(InputError, match=r"two cameras have 0\.png"):
        read_sources(tmp_path, described(tmp_path, *both))


def test_places_that_measuring_clips_show_are_not_trained_on(tmp_path: Path) -> None:
    """The alps and the evening motorway have clips that only measure."""
    names = [
        *("04_us_freeway_5s_mit.mp4", "14_italy_tunnel_webcam.mp4"),
        *("19_caltrans_us101_dark.mp4", "20_caltrans_sr92_grey.mp4", "caltrans_masks/a.mp4"),
        *(f"atl/images/train_{n}_png.jpg" for n in (1020, 102598, 10260016, 10260019, 10260021)),
        *(f"atl/images/train_{n}_png.jpg" for n in (10260026, 1026005, 1026009, "A2", "Z0")),
        *(f"atl/images/{n}_png.jpg" for n in ("test_A11", "test_A3114", "test_C5", "valid_B4")),
        "atl/images/valid_10260070026111110_png.jpg",
        *(f"highway_cars/images/{n}.jpg" for n in ("alps_1_mp4-0", "junction_youtube-0")),
    ]
    for name in names:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    cameras = read_sources(tmp_path)
    assert {path.relative_to(tmp_path).as_posix() for c in cameras for path in c.files} == set(
        names
    )
    kept_out = [name for name in names if "alps" in name or "train_1026" in name]
    learned = {path.name for camera in of_role(cameras, "train") for path in camera.files}
    assert not learned & {Path(name).name for name in kept_out}
    assert {camera.licence for camera in cameras} == {"MIT", "GPL-3.0", "CC BY 4.0"}


def test_boxes_lie_where_a_cut_shows_them() -> None:
    """At any scale, place and side."""
    image = np.zeros((360, 640, 3), np.uint8)
    image[150:210, 300:380] = 255
    shown = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        sample = cut(image, boxes_of((300, 150, 380, 210)), (192, 320), rng, (0.3, 2.5), 0.2)
        assert sample.fine.shape == (384, 640, 3)
        for box in sample.boxes.corners:
            shown += 1
            x1, y1, x2, y2 = (round(2 * side) for side in box)
            part = sample.fine[y1 + 3 : y2 - 3, x1 + 3 : x2 - 3]
            assert part.size == 0 or part.min() > 200
            rows, columns = np.nonzero((sample.fine == 255).all(axis=2))
            assert abs(rows.min() - y1) <= 3
            assert abs(columns.max() + 1 - x2) <= 3
    assert shown >= 8


def test_what_the_seam_hides_is_no_longer_a_box() -> None:
    """Two pictures side by side keep what is seen of their vehicles."""
    rng = np.random.default_rng(1)
    blank = np.zeros((192, 320, 3), np.uint8)
    one = cut(blank, None, (96, 160), rng, (1, 1), 0)
    left = type(one)(one.fine, boxes_of((10, 10, 40, 40), (90, 10, 130, 40)), True)
    right = type(one)(one.fine, boxes_of((20, 50, 60, 80), (100, 50, 150, 80)), False)
    both = side_by_side(left, right, 0.5)
    assert both.boxes.corners.tolist() == [[10, 10, 40, 40], [100, 50, 150, 80]]
    assert not both.detailed


def test_wear_keeps_size_and_follows_the_seed() -> None:
    """The same seed wears a picture in the same way, another one in another."""
    image = np.random.default_rng(1).integers(0, 255, (64, 96, 3), dtype=np.uint8)
    made = [worn(image, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert made[0].shape == image.shape
    assert np.array_equal(made[0], made[1])
    assert not np.array_equal(made[0], made[2])


def test_a_finer_look_counts_where_it_is_surer() -> None:
    """A cell takes the best of its own, of the same cell one stride up, and of its four parts."""
    kinds = len(VEHICLE_CLASSES)
    boxes, scores = np.zeros((PLACES, 4), np.float32), np.zeros((PLACES, kinds), np.float32)
    places = 4 * PLACES
    finer, sure = np.zeros((places, 4), np.float32), np.zeros((places, kinds), np.float32)
    scores[0, 0], scores[5, 1] = 0.6, 0.3
    sure[16 * 24 + 0, 0] = 0.5  # the same cell as place 0, and less sure
    sure[1 * 24 + 10, 1], finer[1 * 24 + 10] = 0.7, 7  # a part of place 5
    own = 8 * 12
    sure[16 * 24 + 8 * 12 + 3, 2] = 0.9  # the same cell as the fourth of the middle stride
    out, said = joined(boxes, scores, finer, sure, SHAPE)
    assert said[0].tolist() == scores[0].tolist()
    assert said[5, 1] == pytest.approx(0.7)
    assert out[5].tolist() == [7, 7, 7, 7]
    assert said[own + 3, 2] == pytest.approx(0.9)
    assert np.count_nonzero(said) == 3


def test_the_teacher_decides_where_it_sees_a_labelled_vehicle() -> None:
    """Hand-made boxes are added only where it sees none."""
    answer = OneCar().answer(np.zeros((2, 2, 3), np.uint8), False)
    left = unknown_to(answer, boxes_of((1, 1, 21, 21), (40, 40, 60, 60)))
    assert left.corners.tolist() == [[40, 40, 60, 60]]


def test_batches_follow_the_seed_and_ask_the_teacher_once(
    cameras: tuple[RealCamera, ...], rendered: Path
) -> None:
    """A broken-off run goes on as if it had not been; a sample's answer is kept."""
    teacher = OneCar()
    batches = Batches(cameras, [rendered], teacher, settings_of())
    first = [batches.draw(number) for number in range(12)]
    again = Batches(cameras, [rendered], OneCar(), settings_of()).draw(11)
    assert np.array_equal(again.images, first[11].images)
    assert len(teacher.asked) == 3
    for batch in first:
        assert batch.images.shape == (4, 3, *SHAPE)
        assert [answer is None for answer in batch.answers] == [False, False, True, True]
    assert any(len(boxes.corners) for batch in first for boxes in batch.boxes[2:])


def test_only_cameras_for_training_are_drawn(
    cameras: tuple[RealCamera, ...], rendered: Path
) -> None:
    """What the teacher is asked about is never the bright camera."""
    teacher = OneCar()
    batches = Batches(cameras, [rendered], teacher, settings_of(distinct=30))
    for number in range(30):
        batches.draw(number)
    assert batches.real_pictures == 2
    assert len(teacher.asked) > 15
    assert max(int(image.max()) for image in teacher.asked) < 200


def test_no_renders_are_refused(cameras: tuple[RealCamera, ...], tmp_path: Path) -> None:
    """Without them the weights would forget what they can."""
    with pytest.raises(InputError, match="no rendered pictures"):
        Batches(cameras, [tmp_path / "empty"], OneCar(), settings_of())


def test_the_rate_warms_up_and_falls() -> None:
    """From little to all of it to a small share."""
    settings = settings_of(pictures=40_000)
    rates = [learning_rate(step, settings) for step in (0, 300, 5_000, settings.steps - 1)]
    assert rates[0] < rates[1] > rates[2] > rates[3]
    assert rates[3] < 0.03 * settings.learning_rate


def test_figures_count_boxes_of_any_class_and_leave_small_ones_out(
    cameras: tuple[RealCamera, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two pictures with a car each, one of them found, with a false box and a small one."""

    class Found:
        """Finds the car of the first picture."""

        calls = 0

        def detect(self, image: Image) -> Detections:
            """A bus in place of the car, a false box of low score, and a tiny one."""
            self.calls += 1
            rows = [(80, 30, 120, 70), (0, 0, 30, 30), (150, 50, 153, 53)][2 * (self.calls > 1) :]
            scores = [0.9, 0.3, 0.9][2 * (self.calls > 1) :]
            return Detections(
                np.array(rows, np.float32),
                np.array(scores, np.float32),
                np.full(len(rows), 2, np.int64),
            )

    monkeypatch.setattr(judging, "open_detector", lambda settings: Found())
    high, low = judge_cameras(tmp_path / "any.xml", cameras[:1])["dark"]
    assert (high.labelled, high.found, high.right) == (2, 1, 1)
    assert (high.recall, high.precision) == (0.5, 1.0)
    assert (low.recall, low.precision) == (0.5, 0.5)


def test_int8_is_fitted_to_both_kinds_of_pictures(
    cameras: tuple[RealCamera, ...], rendered: Path, tmp_path: Path
) -> None:
    """None of them of a camera that is kept out."""
    made = mixed_pictures(tmp_path / "mixed", rendered / "images" / "train", cameras)
    tones = sorted(int(cv2.imread(str(path))[0, 0, 0]) for path in made.iterdir())
    assert tones == [30, 30, 120, 120]


def test_a_model_that_cannot_teach_is_refused(tmp_path: Path) -> None:
    """A file that is no model, and none at all."""
    path = tmp_path / "model.xml"
    path.write_text("<net/>")
    with pytest.raises(InputError, match="not an OpenVINO model"):
        CocoTeacher(path, SHAPE, 1)


def test_real_pictures_need_a_teacher(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And a teacher needs pictures."""
    with pytest.raises(SystemExit) as ended:
        training(["--out", str(tmp_path), "--real", str(tmp_path)])
    assert ended.value.code == 2
    assert "--real and --teacher go together" in capsys.readouterr().err


def test_the_shipped_card_says_what_each_stage_used() -> None:
    """A training that goes on from the shipped weights keeps their rows."""
    stages = list(earlier_stages(builtin_model().with_name("CARD.md")))
    assert len(stages) >= 9
    assert stages[0].name == "wide"
    assert stages[0].pictures == "700"


def test_the_card_names_sources_licences_figures_and_limits(
    cameras: tuple[RealCamera, ...],
) -> None:
    """Who trusts the weights with a real camera finds there what they saw."""
    drawn = DetectionFigures(0.9, 0.7, (0.9,) * 4, (10,) * 4)
    sets = {"roadside": drawn, "wide": drawn}
    figures = {"bright": (RealFigures(0.5, 20, 10, 9), RealFigures(0.1, 20, 30, 15))}
    record = Record(
        date="2026-11-29",
        stages=(StageRecord("wide", "1", "2", "3", 4, 5, "0.1, cosine to 0.1 of it"),),
        held_out_pictures=3,
        shipped=sets,
        in_reach=drawn,
        int8=sets,
        int8_in_reach=drawn,
        by_condition={"night": drawn},
        validator=(0.9, 0.7),
        threads=2,
        minutes=1,
        versions={},
    )
    assert "never seen a real camera" in card_text(record)
    text = card_text(
        replace(record, real=RealRecord(cameras, 2, settings_of(), {"the teacher": figures}))
    )
    assert "never seen a real camera" not in text
    assert "and, by distillation, on real pictures" in text
    assert "| dark | `example.org` | MIT | train |" in text
    assert re.search(
        r"\| bright \| +20 \| the teacher \| +45.0 \| +90.0 \| +75.0 \| +50.0 \|", text
    )
    assert "mostly motorways by day" in text
