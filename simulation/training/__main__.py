"""From scenes to shipped weights in one command: `python -m simulation.training`."""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from simulation.streetdrive.vehicles import CLASSES
from simulation.training.card import REACH_HEIGHT_PX, Record, StageRecord, card_text
from simulation.training.dataset import write_data_yaml, write_dataset
from simulation.training.ranges import QUEUES, RIDERS, ROADSIDE, WIDE
from simulation.training.shipped import openvino_map
from simulation.training.train import TrainSettings, export, train, ultralytics_map

_TOOLS = ("torch", "ultralytics-opencv-headless", "openvino", "opencv-python-headless", "numpy")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not 1 or more")
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m simulation.training", description=__doc__)
    parser.add_argument("--images", type=_positive, default=720, help="training pictures a stage")
    parser.add_argument("--held-out", type=_positive, default=120, help="held-out pictures a stage")
    parser.add_argument("--first-epochs", type=_positive, default=5, help="epochs on wide scenes")
    parser.add_argument("--epochs", type=_positive, default=15, help="epochs on roadside scenes")
    parser.add_argument(
        "--last-epochs", type=_positive, default=8, help="epochs with more motorcycles and jams"
    )
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--threads", type=_positive, default=2, help="CPU threads and processes")
    parser.add_argument("--out", type=Path, required=True, help="folder for data and the run")
    parser.add_argument(
        "--weights",
        type=Path,
        default=Path(__file__).resolve().parents[2] / "edge_daemon" / "weights",
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


def main(argv: list[str] | None = None) -> int:
    """Render, train, export, measure, write the card."""
    chosen = _parser().parse_args(argv)
    begin = time.monotonic()
    sets = {
        limits.name: (limits, chosen.out / limits.name, pictures, held_out)
        for limits, pictures, held_out in (
            (WIDE, chosen.images, chosen.held_out),
            (ROADSIDE, chosen.images, chosen.held_out),
            (RIDERS, chosen.images // 3 + 1, 0),
            (QUEUES, chosen.images, 0),
        )
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
    wide, roadside, riders, queues = (folder for _, folder, _, _ in sets.values())
    plans: tuple[tuple[list[Path], int, float, float], ...] = (
        # The first stage hands over before its rate has fallen, as the first part of a longer run.
        ([wide], chosen.first_epochs, 1e-3, 0.85),
        ([roadside], chosen.epochs, 1e-3, 0.01),
        ([roadside, riders, queues], chosen.last_epochs, 5e-4, 0.01),
    )
    last: Path | None = None
    stages = []
    for number, (folders, epochs, rate, final_rate) in enumerate(plans, start=1):
        settings = TrainSettings(
            epochs=epochs,
            seed=chosen.seed,
            threads=chosen.threads,
            learning_rate=rate,
            final_rate=final_rate,
        )
        data = write_data_yaml(chosen.out / f"stage{number}.yaml", folders, folders[0])
        last = train(data, chosen.out, settings, f"stage{number}", last)
        stages.append(StageRecord.of(folders, settings))
    minutes = (time.monotonic() - begin) / 60
    assert last is not None
    pt, xml = export(last, chosen.weights, chosen.out / "export")
    road, reach = openvino_map(xml, roadside, len(CLASSES), (0.0, REACH_HEIGHT_PX))
    record = Record(
        date=datetime.now(UTC).date().isoformat(),
        stages=tuple(stages),
        held_out_pictures=chosen.held_out,
        shipped={
            ROADSIDE.name: road,
            WIDE.name: openvino_map(xml, wide, len(CLASSES))[0],
        },
        in_reach=reach,
        validator=ultralytics_map(pt, roadside / "data.yaml"),
        minutes=minutes,
        versions=_installed(),
    )
    (chosen.weights / "CARD.md").write_text(card_text(record), encoding="utf-8")
    figures = record.shipped[ROADSIDE.name]
    print(f"mAP50 {figures.map50:.3f}, mAP50-95 {figures.map50_95:.3f}: {xml}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
