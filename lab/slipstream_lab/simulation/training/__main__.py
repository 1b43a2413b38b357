"""From scenes to shipped weights in one command: `python -m slipstream_lab.simulation.training`."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from slipstream_lab.simulation.training.card import (
    REACH_HEIGHT_PX,
    RealRecord,
    Record,
    StageRecord,
    card_text,
    earlier_stages,
)
from slipstream_lab.simulation.training.dataset import write_data_yaml, write_dataset
from slipstream_lab.simulation.training.distillation import (
    Batches,
    CocoTeacher,
    DistilSettings,
    RealCamera,
    distil,
    judge_cameras,
    mixed_pictures,
    of_role,
    read_sources,
)
from slipstream_lab.simulation.training.labelled import read_labelled_set
from slipstream_lab.simulation.training.ranges import (
    BY_CONDITION,
    QUEUES,
    RIDERS,
    ROADSIDE,
    VARIED,
    WIDE,
)
from slipstream_lab.simulation.training.scenes import HELD_OUT, TRAIN
from slipstream_lab.simulation.training.ship import ship
from slipstream_lab.simulation.training.train import (
    INPUT_SHAPE,
    TrainSettings,
    train,
    ultralytics_map,
)
from slipstream_lab.simulation.training.validation import evaluate_model

_TOOLS = ("torch", "ultralytics-opencv-headless", "openvino", "opencv-python-headless", "numpy")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not 1 or more")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m slipstream_lab.simulation.training", description=__doc__
    )
    parser.add_argument("--images", type=_positive, default=720, help="training pictures a stage")
    parser.add_argument("--held-out", type=_positive, default=120, help="held-out pictures a stage")
    parser.add_argument("--first-epochs", type=_positive, default=5, help="epochs on wide scenes")
    parser.add_argument("--epochs", type=_positive, default=15, help="epochs on roadside scenes")
    parser.add_argument(
        "--last-epochs",
        type=_positive,
        default=8,
        help="epochs with more motorcycles and jams, then as many on all ranges",
    )
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--threads", type=_positive, default=2, help="CPU threads and processes")
    parser.add_argument("--out", type=Path, required=True, help="folder for data and the run")
    parser.add_argument(
        "--start",
        type=Path,
        metavar="PT",
        help="weights to go on from, their card beside them: no stages on renders alone",
    )
    parser.add_argument(
        "--real",
        type=Path,
        metavar="DIR",
        help="folder of the real pictures of distillation/sources.toml: learn from these too",
    )
    parser.add_argument(
        "--teacher",
        type=Path,
        metavar="XML",
        help="OpenVINO export of a YOLO11n with COCO's classes that answers for real pictures",
    )
    parser.add_argument(
        "--real-samples",
        type=_positive,
        default=DistilSettings(seed=0).pictures,
        help="real and rendered samples of the stage with real pictures",
    )
    parser.add_argument(
        "--only-render",
        action="store_true",
        help="stop after the labelled pictures; needs no torch, and leaves the weights alone",
    )
    parser.add_argument(
        "--weights",
        type=Path,
        default=Path(__file__).resolve().parents[3] / "edge_daemon" / "weights",
        help="folder that receives the weights and their card",
    )
    return parser


def _installed() -> dict[str, str]:
    found = {}
    for name in _TOOLS:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _learn_from_real(
    chosen: argparse.Namespace, cameras: Sequence[RealCamera], rendered: list[Path], start: Path
) -> tuple[Path, StageRecord, RealRecord]:
    """The weights, what was used, and what the teacher finds on the cameras kept out."""
    settings = DistilSettings(
        pictures=chosen.real_samples, seed=chosen.seed, threads=chosen.threads
    )
    teacher = CocoTeacher(chosen.teacher, settings.shape, 1)
    batches = Batches(cameras, rendered, teacher, settings)
    last = distil(start, chosen.out / "distil", settings, batches)
    judged = judge_cameras(chosen.teacher, of_role(cameras, "validation", "test"))
    real = RealRecord(cameras, batches.real_pictures, settings, {"the teacher": judged})
    boxes = sum(StageRecord.counted(folder)[1] for folder in rendered)
    stage = StageRecord(
        f"{len(of_role(cameras, 'train'))} real cameras, and all ranges",
        str(batches.real_pictures + batches.rendered_pictures),
        f"{boxes} rendered",
        f"{settings.pictures / (batches.real_pictures + batches.rendered_pictures):.1f}",
        settings.seed,
        settings.batch,
        f"{settings.learning_rate:g}, cosine to {settings.final_rate:g} of it",
    )
    return last, stage, real


def main(argv: list[str] | None = None) -> int:
    """Render, train, export, measure, write the card."""
    parser = _parser()
    chosen = parser.parse_args(argv)
    if (chosen.real is None) != (chosen.teacher is None):
        parser.error("--real and --teacher go together")
    cameras = read_sources(chosen.real) if chosen.real else ()
    begin = time.monotonic()
    sets = {
        limits.name: (limits, chosen.out / limits.name, pictures, held_out)
        for limits, pictures, held_out in (
            (WIDE, chosen.images, chosen.held_out),
            (ROADSIDE, chosen.images, chosen.held_out),
            (RIDERS, chosen.images // 2 + 1, 0),
            (QUEUES, chosen.images, 0),
            (VARIED, chosen.images // 2, 0),
            *((limits, chosen.images // 8, chosen.held_out // 5) for limits in BY_CONDITION),
        )
        if pictures + held_out > 0
    }
    # Another seed a set: equal ones would repeat the cameras of the set before.
    for offset, (limits, folder, pictures, held_out) in enumerate(sets.values()):
        write_dataset(
            folder,
            train=pictures,
            held_out=held_out,
            seed=chosen.seed + offset,
            limits=limits,
            workers=chosen.threads,
        )
    folders = {name: folder for name, (_, folder, pictures, _) in sets.items() if pictures > 0}
    wide, roadside = folders[WIDE.name], folders[ROADSIDE.name]
    riders, queues = folders[RIDERS.name], folders[QUEUES.name]
    conditions = [folders[kind.name] for kind in BY_CONDITION if kind.name in folders]
    if chosen.only_render:
        print(write_data_yaml(chosen.out / "data.yaml", list(folders.values()), roadside))
        return 0
    plans: tuple[tuple[list[Path], int, float, float], ...] = (
        # The first stage hands over before its rate has fallen, as the first part of a longer run.
        ([wide], chosen.first_epochs, 1e-3, 0.85),
        ([roadside], chosen.epochs, 1e-3, 0.01),
        ([roadside, riders, queues], chosen.last_epochs, 5e-4, 0.01),
        (list(folders.values()), chosen.last_epochs, 5e-4, 0.01),
    )
    last: Path | None = chosen.start
    stages = list(earlier_stages(chosen.start.with_name("CARD.md"))) if chosen.start else []
    for number, (used, epochs, rate, final_rate) in enumerate(plans, start=1):
        if chosen.start:
            break
        settings = TrainSettings(
            epochs=epochs,
            seed=chosen.seed,
            threads=chosen.threads,
            learning_rate=rate,
            final_rate=final_rate,
            hard_swish=True,
        )
        data = write_data_yaml(chosen.out / f"stage{number}.yaml", used, roadside)
        last = train(data, chosen.out, settings, f"stage{number}", last)
        stages.append(StageRecord.of(used, settings))
    assert last is not None
    calibrate = roadside / "images" / TRAIN
    real = None
    if cameras:
        last, stage, real = _learn_from_real(chosen, cameras, list(folders.values()), last)
        stages.append(stage)
        calibrate = mixed_pictures(chosen.out / "calibration", calibrate, cameras)
    minutes = (time.monotonic() - begin) / 60
    shipped = ship(last, chosen.weights, chosen.out / "export", calibrate)
    if real is not None:
        judged = judge_cameras(shipped.int8_xml, of_role(cameras, "validation", "test"))
        real = replace(real, figures={**real.figures, "these weights, INT8": judged})
    heights = (0.0, REACH_HEIGHT_PX)
    figures = {
        (folder, xml): evaluate_model(
            xml, read_labelled_set(folder / "data.yaml"), INPUT_SHAPE, heights
        )
        for folder in (roadside, wide)
        for xml in (shipped.float_xml, shipped.int8_xml)
    }
    by_condition = {
        folder.name: evaluate_model(
            shipped.float_xml, read_labelled_set(folder / "data.yaml"), INPUT_SHAPE
        )[0]
        for folder in conditions
        if (folder / "images" / HELD_OUT).is_dir()
    }
    record = Record(
        date=datetime.now(UTC).date().isoformat(),
        stages=tuple(stages),
        held_out_pictures=chosen.held_out,
        shipped={f.name: figures[f, shipped.float_xml][0] for f in (roadside, wide)},
        in_reach=figures[roadside, shipped.float_xml][1],
        int8={f.name: figures[f, shipped.int8_xml][0] for f in (roadside, wide)},
        int8_in_reach=figures[roadside, shipped.int8_xml][1],
        by_condition=by_condition,
        validator=ultralytics_map(shipped.pt, roadside / "data.yaml"),
        threads=chosen.threads,
        real=real,
        minutes=minutes,
        versions=_installed(),
    )
    (chosen.weights / "CARD.md").write_text(card_text(record), encoding="utf-8")
    for name, of in (("float", record.shipped), ("INT8", record.int8)):
        print(f"{name}: mAP50 {of['roadside'].map50:.3f}, mAP50-95 {of['roadside'].map50_95:.3f}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
