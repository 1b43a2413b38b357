"""The detectors by name: those of this package, and those that installed packages add.

A package adds one with an entry point in the group ``slipstream.detectors`` whose object is a
`DetectorFactory`; ``detector.backend`` in ``edge.toml`` names it.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Final

from edge_daemon.camera import Camera
from edge_daemon.detection.protocol import Detector
from edge_daemon.settings import BUILTIN_MODEL, DetectorSettings
from slipstream.errors import InputError
from slipstream.plugins import find_plugin, plugin_names

ENTRY_POINTS: Final = "slipstream.detectors"

DetectorFactory = Callable[[DetectorSettings, Camera | None], Detector]


def _openvino(settings: DetectorSettings, camera: Camera | None) -> Detector:
    from edge_daemon.detection.openvino import OpenVinoDetector

    return OpenVinoDetector(model_file(settings), settings, camera)


def _ultralytics(settings: DetectorSettings, camera: Camera | None) -> Detector:
    from edge_daemon.detection.ultralytics import UltralyticsDetector

    return UltralyticsDetector(model_file(settings))


# Each imports its runtime only when it is asked for, so that an RSU loads only the one it uses.
_DETECTORS: Final[dict[str, DetectorFactory]] = {
    "openvino": _openvino,
    "ultralytics": _ultralytics,
}
_DETECTOR_OF_SUFFIX: Final = {".xml": "openvino", ".pt": "ultralytics", ".engine": "ultralytics"}


def detector_names() -> tuple[str, ...]:
    """Names of all detectors that `DetectorSettings.backend` may have."""
    return plugin_names(ENTRY_POINTS, _DETECTORS)


def open_detector(settings: DetectorSettings, camera: Camera | None = None) -> Detector:
    """Open the detector that the settings name or, without a name, that the model file asks for;
    without a camera it searches whole frames.

    Raises:
        InputError: no detector has the name; the file is missing, not a YOLO11 export, has no
            vehicle class, or needs an extra that is not installed.
    """
    name = settings.backend or _detector_for(model_file(settings))
    factory = find_plugin(ENTRY_POINTS, name, _DETECTORS, "detector", "detector.backend")
    return factory(settings, camera)


def model_file(settings: DetectorSettings) -> Path:
    """The file of the model, or the only OpenVINO model of a folder."""
    path = builtin_model() if settings.model == BUILTIN_MODEL else Path(settings.model)
    if path.is_dir():
        models = sorted(path.glob("*.xml"))
        if len(models) != 1:
            raise InputError(path, f"{len(models)} .xml files in the folder", "name the one to use")
        path = models[0]
    if not path.is_file():
        raise InputError(path, "no such model", "give an OpenVINO .xml or a .pt file")
    return path


def builtin_model() -> Path:
    """The shipped weights that suit the CPU: INT8 where it is fast at that, else float."""
    from edge_daemon.detection.processor import fast_int8

    kind = "-int8" if fast_int8() else ""
    return Path(str(resources.files("edge_daemon") / "weights" / f"yolo11n-streetdrive{kind}.xml"))


def _detector_for(path: Path) -> str:
    name = _DETECTOR_OF_SUFFIX.get(path.suffix.lower())
    if name is None:
        raise InputError(
            path,
            f"unknown model type {path.suffix!r}",
            "give .xml, .pt or .engine; `slipstream model export` makes .xml of .pt",
        )
    return name
