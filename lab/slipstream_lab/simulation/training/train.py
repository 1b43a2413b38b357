"""Trains YOLO11n on rendered scenes or other labelled pictures.

Everything that needs torch is imported inside the functions: an RSU has none of it.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from slipstream_lab.simulation.training.scenes import IMAGE_WIDTH

INPUT_SHAPE = (384, 640)
"""Height and width of the network's input; a picture 640 x 360 gets grey bars of 12 rows each."""

WEIGHTS_NAME = "yolo11n-streetdrive"


@dataclass(frozen=True)
class TrainSettings:
    """Settings of a training run.

    `final_rate` is the share of the rate left at the end. With `hard_swish` the network's SiLU
    gives way to hard-swish (Howard et al., ICCV 2019), which costs an RSU a quarter less in INT8.
    """

    epochs: int
    seed: int
    batch: int = 4
    learning_rate: float = 1e-3
    final_rate: float = 0.01
    threads: int = 2
    width: int = IMAGE_WIDTH
    hard_swish: bool = False

    def __post_init__(self) -> None:
        if min(self.epochs, self.batch, self.threads, self.width) < 1:
            raise ValueError("epochs, batch, threads and width are at least 1")
        if not (0 < self.learning_rate < 1 and 0 < self.final_rate <= 1):
            raise ValueError("the learning rate and the final share of it lie between 0 and 1")


def train(
    data: Path, out: Path, settings: TrainSettings, name: str, initial: Path | None = None
) -> Path:
    """Train and return the last epoch's weights (moving average, .pt).

    The last epoch is taken rather than the best one on the held-out scenes, so that these choose
    nothing and their figures stay clean.

    Args:
        initial: weights to start from; random ones when None.
    """
    import torch
    from ultralytics import YOLO

    def use_all_threads(trainer: Any) -> None:
        # Ultralytics leaves one core out; channels-last convolutions are faster on x86-64.
        torch.set_num_threads(settings.threads)
        trainer.model.to(memory_format=torch.channels_last)

    model = YOLO(str(initial) if initial else "yolo11n.yaml", task="detect")
    if settings.hard_swish:
        model.model.yaml["activation"] = "torch.nn.Hardswish()"
    model.add_callback("on_train_start", use_all_threads)
    model.train(
        data=str(data),
        epochs=settings.epochs,
        imgsz=settings.width,
        rect=True,
        batch=settings.batch,
        nbs=settings.batch,
        optimizer="AdamW",
        lr0=settings.learning_rate,
        lrf=settings.final_rate,
        cos_lr=True,
        weight_decay=5e-4,
        warmup_epochs=1.0,
        warmup_bias_lr=0.0,
        hsv_h=0.03,
        hsv_s=0.5,
        hsv_v=0.35,
        fliplr=0.5,
        translate=0.08,
        scale=0.25,
        erasing=0.0,
        amp=False,
        pretrained=initial is not None,
        cache="ram",
        workers=1,
        device="cpu",
        seed=settings.seed,
        deterministic=True,
        plots=False,
        patience=0,
        project=str(out.resolve()),
        name=name,
        val=False,
        exist_ok=True,
        verbose=False,
    )
    return out / name / "weights" / "last.pt"


def ultralytics_map(weights: Path, data: Path, width: int = IMAGE_WIDTH) -> tuple[float, float]:
    """mAP50 and mAP50-95 of a .pt on the held-out split, by Ultralytics' own validator."""
    from ultralytics import YOLO

    with tempfile.TemporaryDirectory() as folder:
        figures = YOLO(str(weights)).val(
            data=str(data),
            imgsz=width,
            rect=True,
            device="cpu",
            plots=False,
            verbose=False,
            project=folder,
        )
    return float(figures.box.map50), float(figures.box.map)
