"""From scenes to shipped weights in one command: `python -m simulation.training`."""

from __future__ import annotations

import argparse
import time
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from simulation.streetdrive.vehicles import CLASSES
from simulation.training.card import Run, card_text
from simulation.training.scenes import TRAIN, write_dataset
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
    parser.add_argument("--images", type=_positive, default=700, help="training pictures")
    parser.add_argument("--held-out", type=_positive, default=120, help="held-out pictures")
    parser.add_argument("--epochs", type=_positive, default=20)
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
    data_folder = chosen.out / "data"
    data = write_dataset(
        data_folder,
        train=chosen.images,
        held_out=chosen.held_out,
        seed=chosen.seed,
        workers=chosen.threads,
    )
    settings = TrainSettings(epochs=chosen.epochs, seed=chosen.seed, threads=chosen.threads)
    begin = time.monotonic()
    last = train(data, chosen.out, settings)
    minutes = (time.monotonic() - begin) / 60
    pt, xml = export(last, chosen.weights, chosen.out / "export")
    labels = (data_folder / "labels" / TRAIN).glob("*.txt")
    run = Run(
        date=datetime.now(UTC).date().isoformat(),
        settings=settings,
        train_pictures=chosen.images,
        train_boxes=sum(len(path.read_text().splitlines()) for path in labels),
        held_out_pictures=chosen.held_out,
        shipped=openvino_map(xml, data_folder, len(CLASSES)),
        validator=ultralytics_map(pt, data),
        minutes=minutes,
        versions=_installed(),
    )
    (chosen.weights / "CARD.md").write_text(card_text(run), encoding="utf-8")
    print(f"mAP50 {run.shipped.map50:.3f}, mAP50-95 {run.shipped.map50_95:.3f}: {xml}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
