"""Detectors by name, those of other packages included."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import openvino as ov
import pytest

from edge_daemon.camera import Camera
from edge_daemon.detection import detector_names, open_detector, openvino
from edge_daemon.settings import DetectorSettings
from slipstream.errors import InputError

PACKAGE = """
import numpy as np
from edge_daemon.detection import Detections


class WholeFrame:
    requests = 1

    def __init__(self, settings, camera):
        self.settings, self.camera = settings, camera

    def detect(self, image):
        height, width = image.shape[:2]
        box = np.array([[0, 0, width, height]], np.float32)
        return Detections(box, np.ones(1, np.float32), np.zeros(1, np.int64))
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with two entry points: a detector, and one whose module is missing."""
    (tmp_path / "whole_frame.py").write_text(PACKAGE)
    info = tmp_path / "whole_frame-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: whole-frame\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[slipstream.detectors]\nwhole = whole_frame:WholeFrame\nbroken = no_such_module:Nothing\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.usefixtures("installed")
def test_a_detector_of_an_installed_package_is_opened_by_its_name(camera: Camera) -> None:
    """It gets the settings and the camera, and needs no model file."""
    assert set(detector_names()) >= {"openvino", "ultralytics", "whole"}
    settings = DetectorSettings(backend="whole", model="none of ours")
    found = open_detector(settings, camera).detect(np.zeros((4, 6, 3), np.uint8))
    assert found.boxes.tolist() == [[0, 0, 6, 4]]


@pytest.mark.usefixtures("installed")
def test_a_package_that_cannot_be_loaded_is_named() -> None:
    """One line, with the key and the object that was looked for."""
    with pytest.raises(InputError, match="no_such_module:Nothing") as caught:
        open_detector(DetectorSettings(backend="broken"))
    assert "detector.backend" in str(caught.value)


def test_a_name_that_nobody_has_is_refused_with_those_that_there_are() -> None:
    """So that a misspelt name is mended without the manual."""
    with pytest.raises(InputError, match=r"no such detector.*openvino, ultralytics"):
        open_detector(DetectorSettings(backend="openvin"))


def test_a_detector_can_be_named_where_the_model_file_would_tell_too() -> None:
    """The built-in model is OpenVINO's either way."""
    named = open_detector(DetectorSettings(backend="openvino", threads=1))
    assert type(named) is type(open_detector(DetectorSettings(threads=1)))


@pytest.mark.slow
def test_no_runtime_is_loaded_before_a_detector_is_opened() -> None:
    """An RSU loads the one that it uses, when it uses it."""
    code = (
        "import sys, edge_daemon.detection, edge_daemon.pipeline\n"
        "assert not {'openvino', 'torch', 'ultralytics'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


class _Core:
    """OpenVINO on a machine with a GPU, whose compiler is what it is given."""

    def __init__(self, compile_model: Callable[..., Any]) -> None:
        self._core, self.compile_model = ov.Core(), compile_model
        self.available_devices = ["CPU", "GPU.0", "GPU.1"]

    def read_model(self, path: Path) -> Any:
        return self._core.read_model(path)


def test_a_device_that_is_not_there_is_one_line() -> None:
    """It names the key and what there is."""
    with pytest.raises(InputError, match="no NPU: OpenVINO has CPU here") as caught:
        open_detector(DetectorSettings(device="NPU"))
    assert caught.value.source == "detector.device"


def test_without_another_device_auto_is_the_cpu(camera: Camera) -> None:
    """It finds as much as the CPU does."""
    width, height = camera.size
    picture = np.zeros((height, width, 3), np.uint8)
    found = open_detector(DetectorSettings(device="auto"), camera).detect(picture)
    assert len(found.boxes) == 0


@pytest.mark.parametrize("device", ["GPU", "auto"])
def test_a_gpu_gets_the_model_without_what_is_for_the_cpu(
    device: Literal["GPU", "auto"], camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """auto takes it where there is one."""
    asked: list[tuple[str, dict[str, Any]]] = []

    def compile_model(model: Any, name: str, hints: dict[str, Any]) -> Any:
        asked.append((name, hints))
        return ov.Core().compile_model(model, "CPU")

    monkeypatch.setattr(openvino, "_runtime", lambda: _Core(compile_model))
    detector = open_detector(DetectorSettings(device=device, threads=1), camera)
    assert asked == [("GPU", {"PERFORMANCE_HINT": "LATENCY"})]
    assert detector.requests == 2


def test_a_device_that_cannot_run_the_model_is_one_line(
    camera: Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the reason that the runtime gives."""

    def compile_model(model: Any, name: str, hints: dict[str, Any]) -> Any:
        raise RuntimeError("Exception from src/core.cpp:1:\nout of device memory\n")

    monkeypatch.setattr(openvino, "_runtime", lambda: _Core(compile_model))
    with pytest.raises(InputError, match=r"the GPU cannot run .*: out of device memory; give"):
        open_detector(DetectorSettings(device="GPU"), camera)
