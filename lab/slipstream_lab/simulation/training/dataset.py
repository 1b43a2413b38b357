"""Renders scenes into folders in the YOLO layout."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import cv2

from slipstream_lab.simulation.streetdrive.vehicles import CLASSES
from slipstream_lab.simulation.training.ranges import SceneRange
from slipstream_lab.simulation.training.scenes import (
    HELD_OUT,
    IMAGE_HEIGHT,
    IMAGE_WIDTH,
    TRAIN,
    TrainingScene,
    render_shots,
)


def yolo_lines(scene: TrainingScene) -> str:
    """The scene's labels as YOLO text: class, centre x, centre y, width, height, all relative."""
    lines = []
    for number, x1, y1, x2, y2 in scene.labels:
        cx, cy = (x1 + x2) / 2 / IMAGE_WIDTH, (y1 + y2) / 2 / IMAGE_HEIGHT
        w, h = (x2 - x1) / IMAGE_WIDTH, (y2 - y1) / IMAGE_HEIGHT
        lines.append(f"{number} {cx:.6f} {cy:.6f} {w:.6f} {h:.6f}\n")
    return "".join(lines)


def _write_stage(index: int, split: str, seed: int, limits: SceneRange, out: Path) -> int:
    cv2.setNumThreads(1)
    boxes = 0
    for shot, scene in enumerate(render_shots(split, index, seed, limits)):
        name = f"{index:05d}-{shot}"
        cv2.imwrite(str(out / "images" / split / f"{name}.png"), scene.image)
        (out / "labels" / split / f"{name}.txt").write_text(yolo_lines(scene), encoding="ascii")
        boxes += len(scene.labels)
    return boxes


def write_dataset(
    out: Path, *, train: int, held_out: int, seed: int, limits: SceneRange, workers: int = 2
) -> Path:
    """Render both splits under `out` in the YOLO layout and return the path of its data.yaml.

    The counts are of pictures; they are rounded up to whole stages.
    """
    for split, count in ((TRAIN, train), (HELD_OUT, held_out)):
        if count == 0:
            continue
        (out / "images" / split).mkdir(parents=True, exist_ok=True)
        (out / "labels" / split).mkdir(parents=True, exist_ok=True)
        task = partial(_write_stage, split=split, seed=seed, limits=limits, out=out)
        stages = -(-count // limits.shots)
        if workers == 1:
            boxes = sum(map(task, range(stages)))
        else:
            # A fork would take along the locks of threads that it does not take along.
            context = get_context("spawn")
            with ProcessPoolExecutor(max_workers=workers, mp_context=context) as pool:
                boxes = sum(pool.map(task, range(stages), chunksize=2))
        print(f"{limits.name} {split}: {stages * limits.shots} pictures, {boxes} boxes", flush=True)
    return write_data_yaml(out / "data.yaml", [out], out)


def write_data_yaml(path: Path, train: Sequence[Path], held_out: Path) -> Path:
    """Write a data.yaml that trains on some rendered sets and validates on one; return its path."""
    names = "".join(f"  {i}: {name}\n" for i, name in enumerate(CLASSES))
    folders = "".join(f"  - {folder.resolve() / 'images' / TRAIN}\n" for folder in train)
    validation = held_out.resolve() / "images" / HELD_OUT
    path.write_text(f"train:\n{folders}val: {validation}\nnames:\n{names}", encoding="utf-8")
    return path
