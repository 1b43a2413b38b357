"""From YOLO11 weights to what an RSU runs: an OpenVINO model with vehicle classes only.

Everything that needs torch is imported inside the functions: an RSU has none of it.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edge_daemon.detection import VEHICLE_CLASSES
from edge_daemon.detection.protocol import vehicle_class_of
from edge_daemon.frame import Image
from slipstream.errors import InputError
from slipstream_lab.simulation.training.calibration import calibration_inputs
from slipstream_lab.simulation.training.labelled import LabelledSet, read_labelled_set
from slipstream_lab.simulation.training.metrics import DetectionFigures
from slipstream_lab.simulation.training.validation import evaluate_model, to_planes

CALIBRATION_PICTURES = 200


@dataclass(frozen=True)
class ExportSettings:
    """What to export and how.

    Attributes:
        shape: (height, width) that the weights were trained at; it fixes the scale at which an RSU
            looks, and the road's part of the picture is cut out at that scale.
        calibrate: clip or folder of pictures that INT8 is fitted to; None: float weights.
        camera: the clip's calibration; None: the camera.toml beside it, if there is one.
        evaluate: data.yaml of a labelled set; None: no figures.
    """

    weights: Path
    out: Path
    shape: tuple[int, int] = (384, 640)
    calibrate: Path | None = None
    camera: Path | None = None
    evaluate: Path | None = None

    def __post_init__(self) -> None:
        if min(self.shape) < 32 or any(side % 32 for side in self.shape):
            raise ValueError("height and width are multiples of 32")


@dataclass(frozen=True)
class ExportReport:
    """What an export made.

    Attributes:
        model: the .xml; its weights, a .bin, lie beside it.
        before: figures of the float model; None without a labelled set.
        after: figures of the INT8 model; None without one, or for a float export.
    """

    model: Path
    classes: tuple[str, ...]
    left_out: int
    megabytes: float
    before: DetectionFigures | None
    after: DetectionFigures | None


def export_model(settings: ExportSettings) -> ExportReport:
    """Export, measure, and write the model into the folder.

    Raises:
        InputError: the weights are no YOLO11 detector of vehicles, or what to calibrate or evaluate
            with is unusable.
        ModuleNotFoundError: the `train` extra is not installed.
    """
    labelled = read_labelled_set(settings.evaluate) if settings.evaluate else None
    inputs = (
        calibration_inputs(
            settings.calibrate, settings.shape, CALIBRATION_PICTURES, settings.camera
        )
        if settings.calibrate
        else None
    )
    yolo = load_yolo(settings.weights)
    kept, left_out = keep_vehicles(yolo, settings.weights)
    with tempfile.TemporaryDirectory() as folder:
        model, metadata = _convert(yolo, settings, Path(folder))
    model.set_rt_info(" ".join(map(str, settings.shape)), ["model_info", "trained_size"])
    before = _evaluated(model, labelled, settings.shape)
    after = None
    name = settings.weights.stem
    if inputs is not None:
        model, name = quantised(model, inputs), f"{name}-int8"
        after = _evaluated(model, labelled, settings.shape)
    path = save(model, metadata, settings.out, name)
    return ExportReport(
        model=path,
        classes=kept,
        left_out=left_out,
        megabytes=(path.stat().st_size + path.with_suffix(".bin").stat().st_size) / 1e6,
        before=before,
        after=after,
    )


def load_yolo(weights: Path) -> Any:
    """A YOLO11 detector, on the processor, with nothing sent or fetched by its library. Raises
    InputError: no such file, or another kind of model.
    """
    if not weights.is_file():
        raise InputError(weights, "no such weights", "give a YOLO11 .pt file")
    # Read when Ultralytics is imported: it would look for updates, and install what it misses.
    os.environ.setdefault("YOLO_OFFLINE", "true")
    os.environ.setdefault("YOLO_AUTOINSTALL", "false")
    from ultralytics import YOLO
    from ultralytics.utils import LOGGER

    LOGGER.setLevel("ERROR")
    try:
        yolo = YOLO(str(weights))
        head = yolo.model.model[-1]
    except Exception as error:
        first = (str(error).splitlines() or ["?"])[0]
        raise InputError(weights, f"not a YOLO model: {first}", "give a YOLO11 .pt file") from None
    if yolo.task != "detect" or type(head).__name__ != "Detect" or head.end2end:
        raise InputError(weights, "not a YOLO11 detector", "give weights of a detection model")
    return yolo


def keep_vehicles(yolo: Any, source: Path) -> tuple[tuple[str, ...], int]:
    """Cut the model's last layer down to the vehicle classes; what it says of these is unchanged.
    Raises InputError: none of its classes is a vehicle.
    """
    import torch

    names = [str(yolo.names[i]) for i in sorted(yolo.names)]
    vehicle_class_of(names, source)
    chosen = [names.index(name) for name in VEHICLE_CLASSES if name in names]
    head = yolo.model.model[-1]
    for branch in head.cv3:
        last = branch[-1]
        last.weight = torch.nn.Parameter(last.weight.detach()[chosen].clone())
        last.bias = torch.nn.Parameter(last.bias.detach()[chosen].clone())
        last.out_channels = len(chosen)
    head.nc, head.no = len(chosen), len(chosen) + 4 * head.reg_max
    kept = tuple(names[i] for i in chosen)
    yolo.model.nc, yolo.model.names = len(chosen), dict(enumerate(kept))
    return kept, len(names) - len(chosen)


def _convert(yolo: Any, settings: ExportSettings, folder: Path) -> tuple[Any, str]:
    """The OpenVINO model with a dynamic input, and Ultralytics' metadata (YAML)."""
    import openvino as ov

    # Ultralytics writes beside the weights.
    yolo.model.pt_path = str(folder / f"{settings.weights.stem}.pt")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = Path(
            yolo.export(
                format="openvino",
                imgsz=list(settings.shape),
                dynamic=True,
                batch=1,
                device="cpu",
                verbose=False,
            )
        )
    # Read whole: the folder goes.
    xml = next(made.glob("*.xml"))
    model = ov.Core().read_model(xml.read_bytes(), xml.with_suffix(".bin").read_bytes())
    metadata = (made / "metadata.yaml").read_text(encoding="utf-8")
    return model, re.sub(r"(?m)^description:.*$", f"description: {settings.weights.stem}", metadata)


def quantised(model: Any, inputs: list[Image]) -> Any:
    """The model in INT8, fitted to inputs (height, width, 3), BGR.

    What turns the heads' answers into boxes stays float: coordinates have more steps than 256.
    """
    import logging

    import nncf

    logging.getLogger("nncf").setLevel(logging.ERROR)
    operations = model.get_ordered_ops()
    last = [op.get_friendly_name() for op in operations if op.get_type_name() == "Sigmoid"][-1]
    head = last.split("/")[0]
    ignored = nncf.IgnoredScope(
        names=[
            name
            for name in (op.get_friendly_name() for op in operations)
            if name == last or name.startswith((f"{head}/", f"{head}.dfl"))
        ],
        validate=False,
    )
    with terminal_only():
        return nncf.quantize(
            model,
            nncf.Dataset(inputs, to_planes),
            preset=nncf.QuantizationPreset.MIXED,
            subset_size=len(inputs),
            ignored_scope=ignored,
        )


@contextmanager
def terminal_only() -> Iterator[None]:
    """Progress bars go to the terminal, and nowhere in a pipe: standard output is for reports."""
    with (
        open(os.devnull, "w") as nowhere,
        redirect_stdout(sys.stderr if sys.stderr.isatty() else nowhere),
    ):
        yield


def save(model: Any, metadata: str, out: Path, name: str) -> Path:
    """Write .xml, .bin (float weights as FP16) and metadata.yaml; the .xml's path."""
    import openvino as ov

    path = out / f"{name}.xml"
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out) as folder:
            made = Path(folder) / path.name
            ov.save_model(model, made, compress_to_fp16=True)
            shutil.move(made.with_suffix(".bin"), path.with_suffix(".bin"))
            shutil.move(made, path)
        (out / "metadata.yaml").write_text(metadata, encoding="utf-8")
    except OSError as error:
        raise InputError(out, error.strerror or "not writable", "choose another --out") from None
    return path


def _evaluated(
    model: Any, labelled: LabelledSet | None, shape: tuple[int, int]
) -> DetectionFigures | None:
    return evaluate_model(model, labelled, shape)[0] if labelled else None
