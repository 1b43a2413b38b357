"""Detectors and their model files."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib import resources
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import openvino as ov
import pytest
from openvino import opset13
from openvino.passes import ConstantFolding, Manager

from edge_daemon.camera import Camera, load_camera
from edge_daemon.camera.segment import WatchedSegment
from edge_daemon.detection import (
    VEHICLE_CLASSES,
    Detections,
    builtin_model,
    detect_stream,
    open_detector,
    processor,
)
from edge_daemon.detection.fixed_input import resized
from edge_daemon.detection.protocol import vehicle_class_of
from edge_daemon.detection.region import road_region
from edge_daemon.frame import Frame
from edge_daemon.settings import DetectorSettings
from edge_daemon.tracking import HIGH_SCORE
from slipstream.errors import InputError

WEIGHTS = Path(str(resources.files("edge_daemon") / "weights"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short clip with its truth and camera."""
    from slipstream_lab.simulation.streetdrive.clip import ClipSettings, render_clip

    path = tmp_path_factory.mktemp("clip")
    render_clip(ClipSettings(seconds=0.5, fps=10, scenario="stable", seed=77), path)
    return path


@pytest.fixture(scope="module")
def rendered(folder: Path) -> tuple[np.ndarray, list[dict[str, str]]]:  # type: ignore[type-arg]
    """The last frame of the clip with its truth rows."""
    import csv

    capture = cv2.VideoCapture(str(folder / "video.mp4"))
    image = None
    for _ in range(5):
        ok, image = capture.read()
        assert ok
    capture.release()
    assert image is not None
    with (folder / "truth.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["frame"] == "4"]
    return image, rows


@pytest.fixture(scope="module")
def road(folder: Path) -> Camera:
    """The camera of the rendered picture."""
    return load_camera(folder / "camera.toml")


def overlap(a: np.ndarray, b: np.ndarray) -> float:  # type: ignore[type-arg]
    """Intersection over union of two boxes."""
    low, high = np.maximum(a[:2], b[:2]), np.minimum(a[2:], b[2:])
    both = float(np.prod(np.clip(high - low, 0, None)))
    return both / float(np.prod(a[2:] - a[:2]) + np.prod(b[2:] - b[:2]) - both)


def weights_of(kind: str) -> str:
    """File of the shipped weights of a kind."""
    return str(WEIGHTS / f"yolo11n-streetdrive{kind}.xml")


def above(score: float, found: Detections) -> Detections:
    """Those that are as sure."""
    sure = found.scores >= score
    return Detections(found.boxes[sure], found.scores[sure], found.classes[sure])


def matched(found: Detections, rows: list[dict[str, str]]) -> tuple[int, int]:
    """How many plainly visible vehicles there are, and how many of them were found."""
    boxes = [
        np.array([float(row[k]) for k in ("x1_px", "y1_px", "x2_px", "y2_px")])
        for row in rows
        if float(row["visible_fraction"]) > 0.7
    ]
    boxes = [box for box in boxes if box[3] - box[1] > 24]
    hits = sum(any(overlap(box, other) > 0.5 for other in found.boxes) for box in boxes)
    return len(boxes), hits


@pytest.mark.long
def test_the_shipped_model_finds_rendered_vehicles(
    rendered: tuple[np.ndarray, list[dict[str, str]]],  # type: ignore[type-arg]
) -> None:
    """Boxes in the picture's own pixels, most plainly visible vehicles among them."""
    image, rows = rendered
    found = above(0.3, open_detector(DetectorSettings()).detect(image))
    there, hits = matched(found, rows)
    assert there >= 3
    assert hits >= 0.8 * there
    assert ((found.scores > 0) & (found.scores <= 1)).all()
    assert set(found.classes.tolist()) <= set(range(len(VEHICLE_CLASSES)))


@pytest.mark.long
def test_the_road_s_part_is_searched_as_the_whole_picture_is(
    rendered: tuple[np.ndarray, list[dict[str, str]]],  # type: ignore[type-arg]
    road: Camera,
) -> None:
    """Sure vehicles well inside the region are found in the same places with it and without."""
    image, _ = rendered
    region = road_region(road)
    assert region is not None
    part = above(0.3, open_detector(DetectorSettings(), road).detect(image))
    whole = above(0.6, open_detector(DetectorSettings()).detect(image))
    low = np.array([region.left, region.top, region.left, region.top]) + 10
    high = np.array([region.right, region.bottom, region.right, region.bottom]) - 10
    inside = whole.boxes[((whole.boxes > low) & (whole.boxes < high)).all(axis=1)]
    assert len(inside) >= 3
    assert all(any(overlap(a, b) > 0.7 for b in part.boxes) for a in inside)
    assert ((part.boxes[:, 2] > region.left) & (part.boxes[:, 3] > region.top)).all()


@pytest.mark.long
def test_pictures_at_a_time_do_not_mix(
    rendered: tuple[np.ndarray, list[dict[str, str]]],  # type: ignore[type-arg]
    road: Camera,
) -> None:
    """With two requests each picture gets its own boxes, those that it gets alone."""
    image, _ = rendered
    empty = np.full_like(image, 100)
    detector = open_detector(DetectorSettings(threads=2), road)
    assert detector.requests == 2
    alone = detector.detect(image)
    frames = [Frame(image if n % 3 else empty, n / 30, 0, 0.0) for n in range(12)]
    for frame, found in detect_stream(frames, detector):
        assert frame is not None
        assert found is not None
        if frame.image is image:
            assert np.array_equal(found.boxes, alone.boxes)
        else:
            assert not (found.scores > HIGH_SCORE).any()


def test_the_built_in_model_suits_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    """INT8 where bytes are multiplied fast; elsewhere float, which finds the same."""
    for flags, name in (({"avx2"}, "-int8"), ({"sse4_2"}, "")):
        monkeypatch.setattr(processor, "_flags", lambda flags=flags: frozenset(flags))
        assert builtin_model().name == f"yolo11n-streetdrive{name}.xml"
        assert builtin_model().is_file()
        assert processor.float_precision() == ov.Type.f32
    monkeypatch.setattr(processor, "_flags", lambda: frozenset({"amx_bf16", "amx_int8"}))
    assert processor.float_precision() == ov.Type.bf16


@pytest.mark.long
def test_float_and_int8_weights_agree(
    rendered: tuple[np.ndarray, list[dict[str, str]]],  # type: ignore[type-arg]
) -> None:
    """What one is sure of the other finds too."""
    image, _ = rendered
    found = [
        above(0.5, open_detector(DetectorSettings(model=weights_of(kind))).detect(image))
        for kind in ("", "-int8")
    ]
    for one, other in (found, found[::-1]):
        hits = sum(any(overlap(a, b) > 0.7 for b in other.boxes) for a in one.boxes)
        assert hits >= 0.9 * len(one)


@pytest.mark.long
def test_an_empty_picture_holds_no_vehicle() -> None:
    """Neither black nor white starts a track."""
    detector = open_detector(DetectorSettings())
    for value in (0, 255):
        found = above(HIGH_SCORE, detector.detect(np.full((720, 1280, 3), value, dtype=np.uint8)))
        assert len(found) == 0
        assert found.boxes.shape == (0, 4)


def test_the_weights_are_small_and_have_a_card() -> None:
    """Under 15 MB in all, and the card tells what they are not good for."""
    assert sum(f.stat().st_size for f in WEIGHTS.iterdir()) < 15e6
    card = (WEIGHTS / "CARD.md").read_text()
    for word in ("mAP50", "mAP50-95", "held-out", "seed", "COCO", "AGPL"):
        assert word in card


def test_model_classes_are_mapped_to_vehicle_classes() -> None:
    """COCO's order is not ours, and what is no vehicle is left out."""
    mapping = vehicle_class_of(["person", "bicycle", "car", "motorcycle", "bus", "truck"], "m")
    assert mapping.tolist() == [-1, -1, 0, 3, 2, 1]
    with pytest.raises(InputError, match="none of its 2 classes"):
        vehicle_class_of(["cat", "dog"], "m")


@pytest.mark.long
def test_coco_weights_find_real_cars(shared_data: Path) -> None:
    """Another model with 80 classes and another input size runs behind the same protocol."""
    capture = cv2.VideoCapture(str(shared_data / "real_highway_640x360.mp4"))
    for _ in range(30):
        ok, image = capture.read()
    capture.release()
    assert ok
    model = str(shared_data / "coco_yolo11n_int8_openvino")
    found = above(0.4, open_detector(DetectorSettings(model=model)).detect(image))
    assert 3 <= len(found) <= 20
    assert found.boxes[:, 2].max() <= image.shape[1] + 5
    # Its input is fixed: it is made anew for the road's part.
    road = np.array([[0.0, 6.0], [0.0, -6.0], [40.0, 6.0], [40.0, -6.0]])
    pixels = np.array([[40.0, 340.0], [600.0, 340.0], [250.0, 180.0], [390.0, 180.0]])
    segment = WatchedSegment("s", road[[0, 1, 3, 2]], np.array([1.0, 0.0]), 40.0, 3, 3.5)
    camera = Camera("motorway", (640, 360), road, pixels, (segment,))
    part = above(0.4, open_detector(DetectorSettings(model=model), camera).detect(image))
    assert len(part) >= 2
    assert sum(any(overlap(a, b) > 0.6 for b in found.boxes) for a in part.boxes) >= 2


def fixed(shape: tuple[int, int]) -> ov.Model:
    """The shipped weights as an export for one size: what follows from it is constant."""
    model = ov.Core().read_model(WEIGHTS / "yolo11n-streetdrive.xml")
    model.reshape([1, 3, *shape])
    manager = Manager()
    manager.register_pass(ConstantFolding())
    manager.run_passes(model)
    return model


@pytest.mark.long
@pytest.mark.slow
def test_an_export_for_one_size_is_made_for_another() -> None:
    """It answers as the same weights with a free input do."""
    made = resized(fixed((128, 192)), (64, 96))
    assert made is not None
    pixels = np.random.default_rng(0).random((1, 3, 64, 96), dtype=np.float32)
    answers = [
        ov.Core().compile_model(model, "CPU", {"INFERENCE_PRECISION_HINT": ov.Type.f32})(pixels)[0]
        for model in (made, fixed((64, 96)))
    ]
    assert np.abs(answers[0] - answers[1]).max() < 1e-3


@pytest.mark.long
@pytest.mark.slow
def test_an_export_of_another_make_keeps_its_size(tmp_path: Path) -> None:
    """Where the places of its boxes are not known, the road's part is letterboxed into it."""
    model = fixed((128, 192))
    for operation in model.get_ordered_ops():
        for port in operation.inputs():
            constant = port.get_source_output().get_node()
            if constant.get_type_name() == "Constant" and list(constant.shape)[-1:] == [504]:
                other = opset13.constant(np.asarray(constant.data) + np.float32(0.25))
                port.replace_source_output(other.output(0))
    assert resized(model, (64, 96)) is None
    ov.save_model(model, tmp_path / "other.xml")
    detector = open_detector(DetectorSettings(model=str(tmp_path / "other.xml")))
    assert len(above(0.9, detector.detect(np.zeros((360, 640, 3), dtype=np.uint8)))) == 0


@pytest.mark.parametrize("case", ["missing", "folder", "suffix", "broken"])
def test_unusable_models_are_one_line(tmp_path: Path, case: str) -> None:
    """The line names the file."""
    path = {
        "missing": tmp_path / "none.xml",
        "folder": tmp_path,
        "suffix": tmp_path / "model.onnx",
        "broken": tmp_path / "broken.xml",
    }[case]
    if case in {"suffix", "broken"}:
        path.write_text("<net")
    with pytest.raises(InputError, match=path.name) as caught:
        open_detector(DetectorSettings(model=str(path)))
    assert "\n" not in str(caught.value)


def test_a_model_for_several_pictures_at_once_is_one_line(tmp_path: Path) -> None:
    """An export with a fixed batch of two fits no single picture."""
    model = ov.Core().read_model(WEIGHTS / "yolo11n-streetdrive.xml")
    model.reshape([2, 3, 384, 640])
    ov.save_model(model, tmp_path / "two.xml")
    with pytest.raises(InputError, match="export it with a 1×3×H×W input"):
        open_detector(DetectorSettings(model=str(tmp_path / "two.xml")))


def test_a_model_without_its_weights_is_one_line(tmp_path: Path) -> None:
    """The .xml alone is not a model."""
    path = tmp_path / "alone.xml"
    shutil.copy(WEIGHTS / "yolo11n-streetdrive.xml", path)
    with pytest.raises(InputError, match="not an OpenVINO model"):
        open_detector(DetectorSettings(model=str(path)))


def test_pt_files_need_the_extra_or_run_through_the_same_protocol(
    rendered: tuple[np.ndarray, list[dict[str, str]]],  # type: ignore[type-arg]
) -> None:
    """Without Ultralytics one line says what to install; with it the boxes are alike."""
    settings = DetectorSettings(model=str(WEIGHTS / "yolo11n-streetdrive.pt"))
    if find_spec("ultralytics") is None:
        with pytest.raises(InputError, match=r"ultralytics-opencv-headless"):
            open_detector(settings)
        return
    image, rows = rendered
    there, hits = matched(above(0.3, open_detector(settings).detect(image)), rows)
    assert hits >= 0.8 * there


@pytest.mark.long
@pytest.mark.process
def test_nothing_is_told_to_anybody(tmp_path: Path) -> None:
    """Opening a model writes no identity into the home folder, as its telemetry would."""
    code = (
        "from edge_daemon.detection import open_detector\n"
        "from edge_daemon.settings import DetectorSettings\n"
        "open_detector(DetectorSettings())"
    )
    subprocess.run(
        [sys.executable, "-c", code], check=True, env=os.environ | {"HOME": str(tmp_path)}
    )
    assert list(tmp_path.iterdir()) == []


DROPPED = """
import gc, os, signal, threading
import numpy as np
from edge_daemon.settings import DetectorSettings
from edge_daemon.detection import open_detector

held = [open_detector(DetectorSettings())]
held[0].detect(np.zeros((720, 1280, 3), np.uint8))


def drop():
    held.clear()
    gc.collect()


signal.signal(signal.SIGTERM, lambda *_: print("heard"))
other = threading.Thread(target=drop)
other.start()
other.join()
fresh = [bytearray(1 << 14) for _ in range(4000)]
os.kill(os.getpid(), signal.SIGTERM)
"""


@pytest.mark.long
@pytest.mark.process
def test_signals_are_heard_after_a_detector_was_dropped_by_another_thread() -> None:
    """OpenVINO unloaded there would take this thread's signal stack with it."""
    done = subprocess.run(
        [sys.executable, "-c", DROPPED], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout) == (0, "heard\n"), done.stderr
