"""`slipstream model`: options, refusals, the report, and the export itself where torch is there."""

from __future__ import annotations

import json
import math
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_daemon.detection import VEHICLE_CLASSES, open_detector
from edge_daemon.settings import DetectorSettings
from slipstream_cli.main import main
from slipstream_lab.commands.model import text
from slipstream_lab.simulation.training.dataset import write_dataset
from slipstream_lab.simulation.training.export import ExportReport
from slipstream_lab.simulation.training.metrics import DetectionFigures
from slipstream_lab.simulation.training.ranges import ROADSIDE

WITH_TORCH = find_spec("torch") is not None and find_spec("ultralytics") is not None


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (["export", "w.pt", "--imgsz", "640"], "not HEIGHTxWIDTH"),
        (["export", "w.pt", "--imgsz", "100x640"], "multiples of 32"),
        (["export", "w.pt", "--int8"], "add --calibrate"),
        (["export", "w.pt", "--calibrate", "clip.mp4"], "add --int8"),
        (["export", "w.pt", "--camera", "c.toml"], "add --int8 --calibrate CLIP"),
        (["train", "d.yaml", "--epochs", "0"], "not 1 or more"),
        (["train", "d.yaml", "--rate", "3"], "out of range"),
    ],
)
def test_bad_options_are_one_line(
    arguments: list[str], fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2 and what to do instead, whether the extra is installed or not."""
    try:
        status: object = main(["model", *arguments])
    except SystemExit as exit_:
        status = exit_.code
    error = capsys.readouterr().err
    assert status == 2
    assert fault in error
    assert error.count("\n") == 1


@pytest.mark.skipif(WITH_TORCH, reason="the extra is installed")
@pytest.mark.parametrize("arguments", [["export", "w.pt"], ["train", "d.yaml"]])
def test_a_missing_extra_is_one_line(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """It says what to install."""
    assert main(["model", *arguments]) == 2
    assert "pip install 'slipstream-lab[train]'" in capsys.readouterr().err


def test_the_report_shows_accuracy_before_and_after() -> None:
    """Both rows, by class; a class that never occurs has a dash."""
    before = DetectionFigures(0.91, 0.7, (0.9, 0.8, math.nan, 1.0), (10, 5, 0, 3))
    after = DetectionFigures(0.9, 0.69, (0.9, 0.7, math.nan, 1.0), (10, 5, 0, 3))
    report = ExportReport(Path("m.xml"), VEHICLE_CLASSES, 76, 3.3, before, after)
    lines = text(report).splitlines()
    assert lines[0] == "m.xml: 3.3 MB, car, truck, bus, motorcycle; 76 other classes left out"
    assert "mAP50 0.910  mAP50-95 0.700" in lines[1]
    assert "truck 0.700 of 5, bus – of 0" in lines[2]


@pytest.fixture(scope="module")
def coco_like(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A YOLO11n with random weights and a few of COCO's classes, in COCO's order."""
    from ultralytics import YOLO

    yolo = YOLO("yolo11n.yaml")
    others = {0: "person", 2: "car", 3: "motorcycle", 5: "bus", 7: "truck"}
    yolo.model.names = {i: others.get(i, f"thing{i}") for i in range(80)}
    path = tmp_path_factory.mktemp("weights") / "coco.pt"
    yolo.save(str(path))
    return path


@pytest.mark.skipif(not WITH_TORCH, reason="needs the train extra")
def test_an_export_says_of_vehicles_what_the_weights_say(
    coco_like: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its boxes and the vehicle classes' scores are those of the .pt, at another size too."""
    import openvino as ov
    import torch
    from ultralytics import YOLO

    out = tmp_path / "out"
    assert main(["model", "export", str(coco_like), "--out", str(out), "--json"]) == 0
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert report["left_out"] == 76
    assert report["classes"] == list(VEHICLE_CLASSES)
    model = ov.Core().compile_model(report["model"], "CPU")
    yolo = YOLO(str(coco_like))
    planes = np.random.default_rng(1).random((1, 3, 256, 352), dtype=np.float32)
    with torch.no_grad():
        wanted = yolo.model.float().eval()(torch.from_numpy(planes))[0].numpy()
    got = model(planes)[0]
    assert got.shape[1] == 8
    assert np.abs(got[0, :4] - wanted[0, :4]).max() < 0.5
    assert np.abs(got[0, 4:] - wanted[0, [4 + 2, 4 + 7, 4 + 5, 4 + 3]]).max() < 1e-3
    # What an RSU opens: the folder.
    found = open_detector(DetectorSettings(model=str(out))).detect(
        np.zeros((720, 1280, 3), np.uint8)
    )
    assert re.match(r"description: coco", (out / "metadata.yaml").read_text())
    assert found.boxes.shape[1] == 4


@pytest.mark.skipif(not WITH_TORCH, reason="needs the train extra")
def test_weights_that_are_none_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A text file with the right suffix, and no file at all."""
    path = tmp_path / "w.pt"
    for fault in ("no such weights", "not a YOLO model"):
        assert main(["model", "export", str(path)]) == 2
        assert fault in capsys.readouterr().err
        path.write_text("no weights")


@pytest.mark.skipif(not WITH_TORCH, reason="needs the train extra")
def test_weights_are_tuned_quantised_and_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On a rendered set: one epoch, then INT8 fitted to its pictures and held against float."""
    data = write_dataset(tmp_path / "set", train=6, held_out=3, seed=3, limits=ROADSIDE, workers=1)
    runs, out = tmp_path / "runs", tmp_path / "out"
    capsys.readouterr()
    options = ["--epochs", "1", "--batch", "2", "--rate", "1e-6", "--out", str(runs), "--json"]
    assert main(["model", "train", str(data), *options]) == 0
    tuned: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert Path(tuned["weights"]).is_file()
    assert tuned["map_after"][0] == pytest.approx(tuned["map_before"][0], abs=0.1)
    pictures = str(tmp_path / "set" / "images" / "train")
    options = ["--int8", "--calibrate", pictures, "--evaluate", str(data), "--out", str(out)]
    assert main(["model", "export", tuned["weights"], *options, "--json"]) == 0
    report: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert report["before"]["map50"] > 0.6
    assert report["after"]["map50"] == pytest.approx(report["before"]["map50"], abs=0.15)
    open_detector(DetectorSettings(model=str(out)))
