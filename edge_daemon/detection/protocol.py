"""What a detector is and which one a model file asks for."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Final, Protocol

import numpy as np
import numpy.typing as npt
from pydantic import Field

from edge_daemon.camera import Camera
from edge_daemon.frame import Image
from slipstream.config import Settings
from slipstream.errors import InputError

VEHICLE_CLASSES: Final = ("car", "truck", "bus", "motorcycle")
BUILTIN_MODEL: Final = "builtin"


class DetectorSettings(Settings):
    """How vehicles are found."""

    model: str = Field(
        default=BUILTIN_MODEL,
        description="'builtin' (trained on renders), an OpenVINO .xml or folder, or a .pt file.",
    )
    min_score: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.1, description="Boxes below are dropped; the tracker has its own higher bar."
    )
    max_overlap: Annotated[float, Field(gt=0, lt=1)] = Field(
        default=0.45, description="Boxes that overlap a better one by more (IoU) are dropped."
    )
    threads: Annotated[int, Field(ge=0)] = Field(
        default=0, description="Inference threads; 0: as many as the machine has cores."
    )
    requests: Annotated[int, Field(ge=0, le=16)] = Field(
        default=0, description="Pictures in the detector at a time; 0: two, on one core one."
    )
    region: bool = Field(
        default=True, description="Search only the part of the picture that holds the road."
    )
    region_margin_m: Annotated[float, Field(ge=0, le=50)] = Field(
        default=3.0, description="How far before and behind segments vehicles have to be whole too."
    )
    scale: Annotated[float, Field(gt=0, le=4)] | None = Field(
        default=None,
        description="Network px for each px of the picture; default: as the model was trained.",
    )


@dataclass(frozen=True)
class Detections:
    """Vehicles found in one picture.

    Attributes:
        boxes: x1, y1, x2, y2 in px of the picture, shape (n, 4).
        scores: in (0, 1], shape (n,).
        classes: index into VEHICLE_CLASSES, shape (n,).
    """

    boxes: npt.NDArray[np.float32]
    scores: npt.NDArray[np.float32]
    classes: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.scores)


class Detector(Protocol):
    """Finds vehicles in a picture.

    Attributes:
        requests: pictures that it takes at a time; `detect` may be called from so many threads.
    """

    @property
    def requests(self) -> int:
        """Pictures at a time."""
        ...

    def detect(self, image: Image) -> Detections:
        """Vehicles in a BGR picture (height, width, 3)."""
        ...


def open_detector(settings: DetectorSettings, camera: Camera | None = None) -> Detector:
    """Open the detector that the model file asks for.

    Args:
        settings: the model and how to run it.
        camera: what it looks at; without it, or with `region = false`, all of the picture.

    Raises:
        InputError: the file is missing, not a YOLO11 export, knows no vehicle class, or needs
            an extra that is not installed.
    """
    path = builtin_model() if settings.model == BUILTIN_MODEL else Path(settings.model)
    if path.is_dir():
        models = sorted(path.glob("*.xml"))
        if len(models) != 1:
            raise InputError(path, f"{len(models)} .xml files in the folder", "name the one to use")
        path = models[0]
    if not path.is_file():
        raise InputError(path, "no such model", "give an OpenVINO .xml or a .pt file")
    # Imported here, so that an RSU loads only the runtime that it uses.
    if path.suffix == ".xml":
        from edge_daemon.detection.openvino import OpenVinoDetector

        return OpenVinoDetector(path, settings, camera)
    if path.suffix in {".pt", ".engine"}:
        from edge_daemon.detection.ultralytics import UltralyticsDetector

        return UltralyticsDetector(path, settings)
    raise InputError(
        path,
        f"unknown model type {path.suffix!r}",
        "give .xml, .pt or .engine; `slipstream model export` makes .xml of .pt",
    )


def builtin_model() -> Path:
    """The shipped weights that suit the processor: INT8 where it is fast at that, else float."""
    from edge_daemon.detection.processor import fast_int8

    kind = "-int8" if fast_int8() else ""
    return Path(str(resources.files("edge_daemon") / "weights" / f"yolo11n-streetdrive{kind}.xml"))


def vehicle_class_of(names: list[str], source: str | Path) -> npt.NDArray[np.int64]:
    """Map a model's classes to VEHICLE_CLASSES; −1 for what is no vehicle.

    Raises:
        InputError: none of the names is a vehicle class.
    """
    mapping = np.array(
        [VEHICLE_CLASSES.index(name) if name in VEHICLE_CLASSES else -1 for name in names],
        dtype=np.int64,
    )
    if (mapping < 0).all():
        raise InputError(
            source,
            f"none of its {len(names)} classes is a vehicle",
            f"give a model with {', '.join(VEHICLE_CLASSES)}",
        )
    return mapping
