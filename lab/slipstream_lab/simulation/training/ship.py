"""Puts trained weights into the edge daemon: .pt, OpenVINO in float and in INT8."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

from slipstream_lab.simulation.training.export import ExportSettings, export_model
from slipstream_lab.simulation.training.train import INPUT_SHAPE, WEIGHTS_NAME


@dataclass(frozen=True)
class Shipped:
    """The files that were written."""

    pt: Path
    float_xml: Path
    int8_xml: Path


def ship(weights: Path, target: Path, work: Path, calibrate: Path) -> Shipped:
    """Ship a checkpoint.

    Args:
        weights: checkpoint of the training run; it is not changed.
        target: folder that receives `yolo11n-streetdrive.pt`, `.xml`, `.bin`, `-int8.xml`,
            `-int8.bin` and `.metadata.yaml`.
        calibrate: training pictures that INT8 is fitted to.
    """
    from ultralytics.utils.torch_utils import strip_optimizer

    work.mkdir(parents=True, exist_ok=True)
    pt = work / f"{WEIGHTS_NAME}.pt"
    shutil.copyfile(weights, pt)
    strip_optimizer(str(pt))
    _remove_paths(pt)
    made = {
        kind: export_model(
            ExportSettings(pt, work / kind, INPUT_SHAPE, calibrate if kind == "int8" else None)
        ).model
        for kind in ("float", "int8")
    }
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(pt, target / pt.name)
    for model in made.values():
        for file in (model, model.with_suffix(".bin")):
            shutil.copyfile(file, target / file.name)
    shutil.copyfile(
        made["float"].with_name("metadata.yaml"), target / f"{WEIGHTS_NAME}.metadata.yaml"
    )
    return Shipped(target / pt.name, target / made["float"].name, target / made["int8"].name)


def _remove_paths(checkpoint: Path) -> None:
    """Drop the folders of the training machine from a checkpoint's record of its arguments."""
    import torch

    content = torch.load(checkpoint, map_location="cpu", weights_only=False)
    for arguments in (content["train_args"], content["model"].args):
        for key in ("data", "project", "save_dir"):
            if key in arguments:
                arguments[key] = Path(str(arguments[key])).name
    for key in ("git", "train_results"):
        content.pop(key, None)
    torch.save(content, checkpoint)
