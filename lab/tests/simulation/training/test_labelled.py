"""Labelled sets, what INT8 is fitted to, and the figures of a model on them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from edge_daemon.detection import VEHICLE_CLASSES, builtin_model
from slipstream.errors import InputError
from slipstream_lab.simulation.training.__main__ import main as training
from slipstream_lab.simulation.training.calibration import calibration_inputs
from slipstream_lab.simulation.training.dataset import write_dataset
from slipstream_lab.simulation.training.labelled import label_of, read_labelled_set
from slipstream_lab.simulation.training.ranges import ROADSIDE
from slipstream_lab.simulation.training.validation import evaluate_model


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data.yaml of a few held-out pictures."""
    folder = tmp_path_factory.mktemp("set")
    return write_dataset(folder, train=0, held_out=3, seed=3, limits=ROADSIDE, workers=1)


def described(tmp_path: Path, text: str) -> Path:
    """A data.yaml beside one picture with one label."""
    for name in ("images", "labels"):
        (tmp_path / name / "val").mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(tmp_path / "images/val/a.png"), np.zeros((100, 200, 3), np.uint8))
    (tmp_path / "labels/val/a.txt").write_text("1 0.5 0.5 0.1 0.2\n0 0.5 0.5 0.1 0.2\n")
    path = tmp_path / "data.yaml"
    path.write_text(text)
    return path


def test_classes_are_mapped_and_others_left_out(tmp_path: Path) -> None:
    """A user's own order of classes becomes ours; a person is no vehicle."""
    labelled = read_labelled_set(
        described(tmp_path, "val: images/val\nnames: {0: person, 1: bus}\n")
    )
    boxes = labelled.boxes(labelled.pictures[0], (200, 100))
    assert boxes.classes.tolist() == [VEHICLE_CLASSES.index("bus")]
    assert boxes.corners[0] == pytest.approx([90, 40, 110, 60])


def test_labels_lie_beside_the_last_folder_of_images() -> None:
    """As the YOLO layout has it, whatever else is called so above."""
    assert label_of(Path("/images/x/images/val/a.jpg")) == Path("/images/x/labels/val/a.txt")


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("val: [", "not YAML"),
        ("a text", "no data.yaml"),
        ("val: images/val\n", "no class names"),
        ("names: [car]\n", "no such split"),
        ("val: nowhere\nnames: [car]\n", "no such folder"),
        ("val: labels\nnames: [car]\n", "no pictures"),
        ("val: images/val\nnames: [cat]\n", "none of its 1 classes is a vehicle"),
    ],
)
def test_unusable_sets_are_one_line(tmp_path: Path, text: str, fault: str) -> None:
    """The line names the file and the fault."""
    path = described(tmp_path, text)
    with pytest.raises(InputError, match=fault) as caught:
        read_labelled_set(path)
    assert "data.yaml" in str(caught.value)


@pytest.mark.parametrize("line", ["car 0 0 1 1", "0 0 0 1", "7 0.5 0.5 1 1", "0 nan 0 1 1"])
def test_a_faulty_label_is_named(tmp_path: Path, line: str) -> None:
    """The file and its line are in the message."""
    labelled = read_labelled_set(described(tmp_path, "val: images/val\nnames: [car, bus]\n"))
    (tmp_path / "labels/val/a.txt").write_text(f"0 0.5 0.5 0.1 0.1\n{line}\n")
    with pytest.raises(InputError, match=r"a\.txt: line 2: no box"):
        labelled.boxes(labelled.pictures[0], (200, 100))


@pytest.mark.long
def test_the_shipped_model_does_well_on_held_out_pictures(rendered: Path) -> None:
    """Figures of its card cannot be told from six pictures, but nonsense can."""
    figures = evaluate_model(builtin_model(), read_labelled_set(rendered), (384, 640), (0.0, 12.0))
    assert 0.7 < figures[0].map50 <= 1
    assert figures[0].map50 > figures[0].map50_95 > 0.4
    assert sum(figures[1].boxes) <= sum(figures[0].boxes)


@pytest.mark.long
def test_sets_can_be_rendered_without_training(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What `slipstream model train` takes; no weights are touched."""
    weights = tmp_path / "weights"
    counts = ["--images", "1", "--held-out", "1", "--threads", "1"]
    options = ["--only-render", "--out", str(tmp_path / "sets"), "--weights", str(weights)]
    assert training([*counts, *options]) == 0
    data = Path(capsys.readouterr().out.splitlines()[-1])
    assert len(read_labelled_set(data, "train").pictures) >= 4
    assert read_labelled_set(data, "val").pictures
    assert not weights.exists()


def test_pictures_of_a_folder_keep_the_scale_of_training(rendered: Path) -> None:
    """640×360 pictures lie unscaled in 640×384."""
    inputs = calibration_inputs(rendered.parent, (384, 640), 3)
    assert [i.shape for i in inputs] == [(384, 640, 3)] * 3
    assert (inputs[0][:12] == 114).all()
    again = calibration_inputs(rendered.parent, (384, 640), 3)
    assert all(np.array_equal(a, b) for a, b in zip(inputs, again, strict=True))


def test_frames_of_a_clip_are_cut_out_as_an_rsu_does(mixed_clip: Any) -> None:
    """With the calibration beside the clip only the road's part is taken, at half its size."""
    inputs = calibration_inputs(mixed_clip.folder / "video.mp4", (384, 640), 5)
    assert len(inputs) == 5
    height, width = inputs[0].shape[:2]
    assert height % 32 == width % 32 == 0
    assert height * width < 384 * 640


def test_nothing_to_calibrate_on_is_one_line(tmp_path: Path) -> None:
    """Neither an empty folder nor a text file has pictures."""
    with pytest.raises(InputError, match="no pictures"):
        calibration_inputs(tmp_path, (384, 640), 4)
    (tmp_path / "clip.mp4").write_text("no video")
    with pytest.raises(InputError, match="not a readable video"):
        calibration_inputs(tmp_path / "clip.mp4", (384, 640), 4)
    with pytest.raises(InputError, match="no such clip"):
        calibration_inputs(tmp_path / "none.mp4", (384, 640), 4)
