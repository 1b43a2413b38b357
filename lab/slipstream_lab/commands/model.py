"""`slipstream model`: YOLO11 weights to what an RSU runs, fine-tuning, and a trial on a clip."""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.errors import InputError
from slipstream_cli.clip_options import add_config, add_fps, settings_of
from slipstream_cli.progress import ProgressLine

if TYPE_CHECKING:
    from slipstream_lab.research.perception.coverage import Coverage
    from slipstream_lab.simulation.training.export import ExportReport

_BUILTIN = "yolo11n-streetdrive.pt"


def _size(text: str) -> tuple[int, int]:
    """(height, width) from a text like 384x640."""
    try:
        height, width = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not HEIGHTxWIDTH, like 384x640") from None
    if min(height, width) < 32 or height % 32 or width % 32:
        raise argparse.ArgumentTypeError(f"{text}: height and width are multiples of 32")
    return height, width


def _positive(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not 1 or more")
    return int(text)


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the sub-command."""
    command = commands.add_parser(
        "model",
        help="export, fine-tune and try YOLO11 weights for an RSU",
        description="`export` and `train` need the `train` extra, best in an environment of its "
        "own: it brings torch.",
    )
    actions = command.add_subparsers(dest="action", required=True, metavar="ACTION")
    _add_export(actions)
    _add_train(actions)
    _add_check(actions)


def _add_check(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    check = actions.add_parser(
        "check",
        help="which share of what moves in a clip a model finds",
        description="What moves is told by the picture alone, five times a second, as the fault "
        "`blind` tells it. Without --camera all that moves counts, trees and people too. Exit "
        "status 1 if the model is not found usable.",
    )
    check.add_argument("model", metavar="MODEL", help="'builtin', an .xml, its folder, or a .pt")
    check.add_argument("clip", type=Path, metavar="CLIP", help="of what the camera shows, 15 s up")
    check.add_argument("--camera", type=Path, help="its calibration: only the road counts")
    add_fps(check)
    add_config(check)
    check.add_argument("--json", action="store_true", help="print the figures as JSON")
    check.set_defaults(run=run_check)


def _add_export(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    export = actions.add_parser(
        "export",
        help="weights (.pt) to an OpenVINO model for `[detector] model` and `track --model`",
        description="Any YOLO11 detector will do, COCO's included: its classes are cut down to "
        "car, truck, bus and motorcycle. The input stays dynamic: an RSU cuts the road's part out "
        "of the picture and looks at it at the scale of --imgsz.",
    )
    export.add_argument("weights", type=Path, metavar="WEIGHTS.pt", help="of YOLO11")
    export.add_argument(
        "--imgsz",
        type=_size,
        default=(384, 640),
        metavar="HxW",
        help="size at which all of a picture would be looked at, as in training (default 384x640)",
    )
    export.add_argument(
        "--out", type=Path, help="folder for the model (default: WEIGHTS_openvino_model)"
    )
    export.add_argument(
        "--int8", action="store_true", help="quantise: twice as fast where there is VNNI or AMX"
    )
    export.add_argument(
        "--calibrate",
        type=Path,
        metavar="CLIP",
        help="with --int8: a clip, or a folder of pictures, of what it will look at",
    )
    export.add_argument(
        "--camera",
        type=Path,
        help="the clip's camera.toml, so that it is cut out as an RSU would "
        "(default: the one beside the clip)",
    )
    export.add_argument(
        "--evaluate",
        type=Path,
        metavar="DATA.yaml",
        help="labelled set (YOLO layout): accuracy on its `val` pictures, before and after INT8",
    )
    export.add_argument("--json", action="store_true", help="print the report as JSON")
    export.set_defaults(run=run_export)


def _add_train(actions: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    train = actions.add_parser(
        "train",
        help="fine-tune weights on labelled pictures",
        description="Labels in the YOLO layout; "
        "`python -m slipstream_lab.simulation.training --only-render` renders such sets. "
        "The weights of the last epoch are kept, so that the val pictures choose nothing.",
    )
    train.add_argument("data", type=Path, metavar="DATA.yaml", help="labelled set")
    train.add_argument(
        "--weights", type=Path, metavar="W.pt", help=f"start from these (default: {_BUILTIN})"
    )
    train.add_argument("--epochs", type=_positive, default=10, help="of training")
    train.add_argument("--batch", type=_positive, default=4, help="pictures a step")
    train.add_argument("--rate", type=float, default=5e-4, help="AdamW's rate (default 0.0005)")
    train.add_argument("--width", type=_positive, default=640, help="pictures are scaled to, px")
    train.add_argument("--threads", type=_positive, default=2, help="of torch")
    train.add_argument(
        "--hard-swish",
        action="store_true",
        help="with hard-swish for SiLU: a quarter faster in INT8 (the shipped weights have it)",
    )
    train.add_argument("--seed", type=int, default=1, help="of everything random")
    train.add_argument(
        "--out", type=Path, default=Path("runs"), help="folder for the run (default runs)"
    )
    train.add_argument("--json", action="store_true", help="print the figures as JSON")
    train.set_defaults(run=run_train)


def run_export(options: argparse.Namespace) -> int:
    """Export, and print what was measured."""
    if options.int8 and options.calibrate is None:
        raise InputError("--int8", "needs pictures to fit to", "add --calibrate CLIP")
    if options.calibrate is not None and not options.int8:
        raise InputError("--calibrate", "is for INT8", "add --int8")
    if options.camera is not None and (options.calibrate is None or options.calibrate.is_dir()):
        raise InputError("--camera", "is of a clip to fit to", "add --int8 --calibrate CLIP")
    _need("torch", "ultralytics", "nncf", "openvino")
    from slipstream_lab.simulation.training.export import ExportSettings, export_model

    out = options.out or options.weights.with_name(f"{options.weights.stem}_openvino_model")
    report = export_model(
        ExportSettings(
            weights=options.weights,
            out=out,
            shape=options.imgsz,
            calibrate=options.calibrate,
            camera=options.camera,
            evaluate=options.evaluate,
        )
    )
    if options.json:
        print(json.dumps(_plain(asdict(report)), default=str))
    else:
        print(text(report))
    return 0


def run_train(options: argparse.Namespace) -> int:
    """Fine-tune, and print where the weights are."""
    if not 0 < options.rate < 1:
        raise InputError("--rate", f"{options.rate:g} is out of range", "give one below 1, as 5e-4")
    _need("torch", "ultralytics")
    from slipstream_lab.simulation.training.export import load_yolo, terminal_only
    from slipstream_lab.simulation.training.labelled import read_labelled_set
    from slipstream_lab.simulation.training.train import TrainSettings, train, ultralytics_map

    for split in ("train", "val"):
        read_labelled_set(options.data, split)
    weights = options.weights or Path(str(resources.files("edge_daemon") / "weights" / _BUILTIN))
    load_yolo(weights)
    settings = TrainSettings(
        epochs=options.epochs,
        seed=options.seed,
        batch=options.batch,
        learning_rate=options.rate,
        threads=options.threads,
        width=options.width,
        hard_swish=options.hard_swish,
    )
    with terminal_only():
        before = ultralytics_map(weights, options.data, options.width)
        last = train(options.data, options.out, settings, options.data.stem, weights)
        after = ultralytics_map(last, options.data, options.width)
    if options.json:
        print(json.dumps({"weights": str(last), "map_before": before, "map_after": after}))
        return 0
    print(f"{last}\nmAP50 {before[0]:.3f} -> {after[0]:.3f}", end="")
    print(f", mAP50-95 {before[1]:.3f} -> {after[1]:.3f} (Ultralytics' validator)")
    return 0


def run_check(options: argparse.Namespace) -> int:
    """Measure, and print what is covered."""
    from edge_daemon.camera import load_camera
    from slipstream_lab.research.perception.coverage import measure_coverage

    settings = settings_of(options)
    detector = settings.detector.model_copy(update={"model": options.model, "backend": None})
    camera = None if options.camera is None else load_camera(options.camera)
    with ProgressLine("looking", sys.stderr) as progress:
        coverage = measure_coverage(
            options.clip,
            detector,
            camera,
            progress.update,
            fps=options.fps,
        )
    if options.json:
        shares = {"share": coverage.share, "false_share": coverage.false_share}
        print(json.dumps(asdict(coverage) | {"things": coverage.things} | shares))
    else:
        print(coverage_text(coverage))
    return 0 if coverage.verdict == "usable" else 1


def coverage_text(coverage: Coverage) -> str:
    """The figures as people read them, the verdict last."""
    from slipstream_lab.research.perception.coverage import MAX_FALSE, MIN_COVERED, MIN_THINGS

    lines = ["        range             moving  covered  at any score"]
    for band in coverage.bands:
        shares = (
            f"{count / band.things:.0%}" if band.things else "–"
            for count in (band.covered, band.covered_at_all)
        )
        reach = (
            f"from {band.begin:g} {coverage.unit}"
            if band.end is None
            else f"{band.begin:g} to {band.end:g} {coverage.unit}"
        )
        lines.append(
            "{:7} {:16} {:7}  {:>7}  {:>12}".format(band.name, reach, band.things, *shares)
        )
    classes = ", ".join(f"{name} {count}" for name, count in coverage.classes.items() if count)
    lines.append(f"found as: {classes or 'nothing'}")
    lines.append(
        f"false: {coverage.false} boxes come and go where nothing moves, "
        f"{coverage.false_share:.0%} of these and what is covered (limit {MAX_FALSE:.0%})"
    )
    measured = f"{coverage.share:.0%} of {coverage.things} moving things covered"
    judged = f"{measured} (limit {MIN_COVERED:.0%}), {coverage.false_share:.0%} false boxes"
    lines.append(
        {
            "usable": f"usable: {judged}",
            "doubtful": f"doubtful: {judged}",
            "blind": f"blind: {measured} (a daemon reports the fault below 25%)",
            "unsure": f"unsure: {coverage.things} moving things in {coverage.pictures} pictures "
            f"are too few (limit {MIN_THINGS}); give a longer clip, or one with traffic",
        }[coverage.verdict]
    )
    return "\n".join(lines)


def text(report: ExportReport) -> str:
    """The report as people read it."""
    classes = ", ".join(report.classes)
    left_out = f"; {report.left_out} other classes left out" if report.left_out else ""
    lines = [f"{report.model}: {report.megabytes:.1f} MB, {classes}{left_out}"]
    for name, figures in (("float", report.before), ("INT8", report.after)):
        if figures is not None:
            each = ", ".join(
                f"{label} {'–' if math.isnan(ap) else f'{ap:.3f}'} of {count}"
                for label, ap, count in zip(
                    ("car", "truck", "bus", "motorcycle"), figures.ap50, figures.boxes, strict=True
                )
            )
            lines.append(
                f"{name:5}  mAP50 {figures.map50:.3f}  mAP50-95 {figures.map50_95:.3f}  "
                f"(AP50: {each})"
            )
    return "\n".join(lines)


def _need(*modules: str) -> None:
    """Say at once, in one line, that the extra is missing."""
    from importlib.util import find_spec

    for name in modules:
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"no module named {name}", name=name)


def _plain(value: object) -> object:
    """Without NaN, which is no JSON."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
