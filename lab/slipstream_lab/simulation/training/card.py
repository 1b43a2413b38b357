"""Writes the card that travels with the shipped weights."""
# ruff: noqa: E501 (the text is Markdown)

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

from slipstream.errors import InputError
from slipstream.files import read_text
from slipstream_cli.tables import markdown_table
from slipstream_lab.simulation.streetdrive.vehicles import CLASSES
from slipstream_lab.simulation.training.distillation import (
    JUDGED_HEIGHT_PX,
    DistilSettings,
    RealCamera,
    RealFigures,
)
from slipstream_lab.simulation.training.export import CALIBRATION_PICTURES
from slipstream_lab.simulation.training.metrics import DetectionFigures
from slipstream_lab.simulation.training.ranges import CONDITIONS, ROADSIDE, VARIED, WIDE
from slipstream_lab.simulation.training.scenes import MIN_HEIGHT_PX, MIN_VISIBLE_FRACTION, TRAIN
from slipstream_lab.simulation.training.train import WEIGHTS_NAME, TrainSettings

_MAX_BYTES = 1_000_000

REACH_HEIGHT_PX = 12.0
"""Box height, at 640 px width, of a car at the far end of a clip's monitored segment."""


_STAGE_COLUMNS = ("range", "training pictures", "boxes", "epochs", "seed", "batch", "AdamW rate")


@dataclass(frozen=True)
class StageRecord:
    """What one stage of the training used: a row of the card's table."""

    name: str
    pictures: str
    boxes: str
    epochs: str
    seed: int | str
    batch: int | str
    rate: str

    @classmethod
    def of(cls, folders: Sequence[Path], settings: TrainSettings) -> StageRecord:
        """Count the training pictures and boxes of rendered sets, which give the stage its name."""
        counts = [cls.counted(folder) for folder in folders]
        return cls(
            " + ".join(f.name for f in folders),
            str(sum(pictures for pictures, _ in counts)),
            str(sum(boxes for _, boxes in counts)),
            str(settings.epochs),
            settings.seed,
            settings.batch,
            f"{settings.learning_rate:g}, cosine to {settings.final_rate:g} of it",
        )

    @staticmethod
    def counted(folder: Path) -> tuple[int, int]:
        """Training pictures and boxes of a rendered set."""
        texts = [path.read_text() for path in (folder / "labels" / TRAIN).glob("*.txt")]
        return len(texts), sum(len(text.splitlines()) for text in texts)


def earlier_stages(card: Path) -> Iterator[StageRecord]:
    """The rows of a card's table of stages. Raises InputError: no card, or none of that kind."""
    lines = read_text(card, _MAX_BYTES).splitlines()
    head = "| " + " | ".join(_STAGE_COLUMNS) + " |"
    if head not in lines:
        raise InputError(card, "no table of stages", "give weights with a card written here")
    for line in lines[lines.index(head) + 2 :]:
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) != len(_STAGE_COLUMNS):
            return
        yield StageRecord(*cells)


@dataclass(frozen=True)
class RealRecord:
    """What was learned from real cameras.

    `figures` are those of several models, by model and by camera, for several least scores.
    """

    cameras: Sequence[RealCamera]
    pictures: int
    settings: DistilSettings
    figures: dict[str, dict[str, tuple[RealFigures, ...]]]


@dataclass(frozen=True)
class Record:
    """What a finished training measured.

    `shipped` and `int8` hold the figures of the float and the INT8 model by the stage's name.
    """

    date: str
    stages: tuple[StageRecord, ...]
    held_out_pictures: int
    shipped: dict[str, DetectionFigures]
    in_reach: DetectionFigures
    int8: dict[str, DetectionFigures]
    int8_in_reach: DetectionFigures
    by_condition: dict[str, DetectionFigures]
    validator: tuple[float, float]
    threads: int
    minutes: float
    versions: dict[str, str]
    remark: str = ""
    real: RealRecord | None = None


def _stage_table(record: Record) -> str:
    return markdown_table(_STAGE_COLUMNS, [astuple(s) for s in record.stages], left=(0, 6))


def _share(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.1f}"


def _real_figures(real: RealRecord) -> str:
    """Recall and precision on the cameras kept out of training, by model."""
    rows = [
        (
            f"{camera}" + (f" ({role})" if role == "validation" else ""),
            f"{row[0].labelled}",
            model,
            *(_share(value) for figure in row for value in (figure.recall, figure.precision)),
        )
        for model, by_camera in real.figures.items()
        for camera, row in by_camera.items()
        for role in [next(c.role for c in real.cameras if c.name == camera)]
    ]
    scores = [figure.score for figure in next(iter(next(iter(real.figures.values())).values()))]
    columns = ["camera", "boxes", "model"]
    for score in scores:
        columns += [f"recall at {score:g}, %", f"precision at {score:g}, %"]
    return f"""
On hand-made boxes of real cameras that training has not seen, at least {JUDGED_HEIGHT_PX:.0f} px high at 640 px picture width, any class, IoU 0.5:

{markdown_table(columns, sorted(rows), left=(0, 2))}
"""


def _real_data(real: RealRecord) -> str:
    """Sources, and what was learned from them."""
    rows = [(c.name, f"`{c.source}`", c.licence, c.role) for c in real.cameras]
    s = real.settings
    return f"""
### Real pictures
{markdown_table(("camera", "source", "licence", "for"), rows, left=(0, 1, 2, 3))}

{real.pictures} pictures of the cameras for training; of clips, one frame in {s.every}. None of them is part of this package. A teacher,
YOLO11n with COCO's weights (not part of this package either), answers for {s.distinct} cuts of them, {s.shape[0]}×{s.shape[1]}, at two scales: the
student learns its scores and boxes at each place of the network as they are, and what its heads look at. Hand-made boxes
that the teacher does not find are added. {s.rendered} of {s.batch} samples of a batch are renders. Each sample is worn anew: light, colours,
haze, blur, noise, few pixels, strong compression. {s.pictures} samples in all; the weights are the moving average after
the last one by {1 - s.former_share:.0%}, and by {s.former_share:.0%} what they were before. Classes on
real pictures are the teacher's: vans and pick-ups are cars or trucks as COCO has them.
"""


def _class_table(record: Record) -> str:
    road, road8 = record.shipped[ROADSIDE.name], record.int8[ROADSIDE.name]
    reach, reach8 = record.in_reach, record.int8_in_reach
    columns = (
        *("class", "roadside held-out boxes", "AP50", "INT8"),
        *(f"of at least {REACH_HEIGHT_PX:.0f} px", "AP50", "INT8"),
    )
    rows = (
        (name, count, f"{ap:.3f}", f"{ap8:.3f}", near, f"{near_ap:.3f}", f"{near_ap8:.3f}")
        for name, count, ap, ap8, near, near_ap, near_ap8 in zip(
            *(CLASSES, road.boxes, road.ap50, road8.ap50),
            *(reach.boxes, reach.ap50, reach8.ap50),
            strict=True,
        )
    )
    return markdown_table(columns, rows)


def _condition_table(record: Record) -> str:
    """Held-out roadside pictures under each kind of conditions, by the float model."""
    columns = ("roadside in", "held-out boxes", "mAP50", *CLASSES)
    rows = (
        (kind, sum(of.boxes), f"{of.map50:.3f}", *(f"{ap:.3f}" for ap in of.ap50))
        for kind, of in record.by_condition.items()
    )
    return markdown_table(columns, rows)


def _limits(real: RealRecord | None) -> str:
    if real is None:
        return """For StreetDrive pictures only. These weights have never seen a real camera: there, use weights trained on
COCO or on pictures of the camera in question."""
    return """The real cameras are few: mostly motorways by day, one by night, no snow, little rain. `slipstream model check`
says what these weights find at a camera in question; weights of a large set, or of that camera, find more."""


def card_text(record: Record) -> str:
    """The card as Markdown."""
    road, wide = record.shipped[ROADSIDE.name], record.shipped[WIDE.name]
    reach, real = record.in_reach, record.real
    road8, wide8, reach8 = record.int8[ROADSIDE.name], record.int8[WIDE.name], record.int8_in_reach
    versions = ", ".join(f"{name} {version}" for name, version in record.versions.items())
    classes = ", ".join(f"{i} {name}" for i, name in enumerate(CLASSES))
    return f"""# {WEIGHTS_NAME}

YOLO11n with hard-swish in place of SiLU, trained from random weights on StreetDrive renders{" and, by distillation, on real pictures" if real else " only"}. Classes: {classes}.
Made on {record.date} by `lab/slipstream_lab/simulation/training`; `python -m slipstream_lab.simulation.training --out DIR` does scenes, training,
export, measuring and this card.
{record.remark}

| file | what |
|---|---|
| `{WEIGHTS_NAME}-int8.xml`, `.bin` | OpenVINO in INT8 (NNCF, after training), dynamic input; run where the processor has AVX2, AMX or Arm's dot products |
| `{WEIGHTS_NAME}.xml`, `.bin` | OpenVINO, dynamic input, weights stored as FP16; run elsewhere |
| `{WEIGHTS_NAME}.metadata.yaml` | class names, stride, input size |
| `{WEIGHTS_NAME}.pt` | the same weights for Ultralytics, half precision, optimizer stripped |

## Figures on held-out pictures
Own COCO-style evaluation of the shipped OpenVINO models at 384×640; float, then INT8:

| measured on | mAP50 | mAP50-95 | INT8 mAP50 | mAP50-95 |
|---|---|---|---|---|
| {record.held_out_pictures} roadside pictures | {road.map50:.3f} | {road.map50_95:.3f} | {road8.map50:.3f} | {road8.map50_95:.3f} |
| the same, boxes of at least {REACH_HEIGHT_PX:.0f} px | {reach.map50:.3f} | {reach.map50_95:.3f} | {reach8.map50:.3f} | {reach8.map50_95:.3f} |
| {record.held_out_pictures} wide pictures | {wide.map50:.3f} | {wide.map50_95:.3f} | {wide8.map50:.3f} | {wide8.map50_95:.3f} |
| roadside, the `.pt`, Ultralytics' validator (rectangular, padded to 384×672) | {record.validator[0]:.3f} | {record.validator[1]:.3f} | | |

{_class_table(record)}

{_condition_table(record)}
{_real_figures(real) if real else ""}
INT8 was fitted to {CALIBRATION_PICTURES} {"real and " if real else ""}roadside training pictures; what turns the heads' answers into boxes stays float.

Cars at the far end (77 to 80 m) of a StreetDrive clip's monitored segment measured 11 to 18 px, 13 in the
median, at 640 px picture width, hence the row with a least height, which is no substitute for the first row. Lower
boxes are left out on both sides there, as COCO does with area ranges.

Scores from 0.001 up, NMS per class at IoU 0.7, at most 300 boxes a picture, AP over 101 recall points
(`lab/slipstream_lab/simulation/training/metrics.py`, `validation.py`).

## Data
Rendered at 1280×720 and reduced to 640×360. Drawn at random: camera height, focal length, pitch, yaw, roll
and place; one to three lanes a side; density from free to dense; vehicle shapes, sizes and paints; sun,
overcast and haze; scenery, tree shadows, pedestrians, signs, cabinets, and posts close to the camera; blur,
vignette, noise, contrast, gamma, colour cast and JPEG quality. Ranges (`lab/slipstream_lab/simulation/training/ranges.py`):
*wide* has cameras from {WIDE.height_m[0]:g} to {WIDE.height_m[1]:g} m in any state and vehicles up to {WIDE.far_m[1]:g} m away; *roadside* has poles of
{ROADSIDE.height_m[0]:g} to {ROADSIDE.height_m[1]:g} m with a camera in working order and most vehicles within the label rule's reach; *riders*,
only for training, is the roadside with many motorcycles, *queues* the roadside in a jam; *varied*,
only for training, has vehicles, paints and surfaces far beyond StreetDrive's own and lenses up to
{VARIED.focal_px[1]:g} px. The roadside comes also in {", ".join(CONDITIONS)}.

A vehicle is labelled when at least {MIN_VISIBLE_FRACTION:.0%} of its silhouette is visible inside the picture and its box
is at least {MIN_HEIGHT_PX:.0f} px high at 640 px picture width. Others stay in the picture unlabelled.

The held-out pictures share no random seed, no camera (height and focal length come from disjoint bins)
and no palette (paints and surfaces come from disjoint lists) with the training pictures. No epoch is picked
by them: the weights are the moving average after the last one.
{_real_data(real) if real else ""}
## Training
{_stage_table(record)}

Each stage starts from the weights of the one before. Rectangular batches of 384×640, no mosaic; flips,
hue/saturation/value, shift and scale as augmentation. {record.minutes:.0f} minutes on {record.threads} CPU threads that other work shared.
{versions}.

## Input and output
Input: RGB, 0..1 (divide by 255 before the model; the model does not), planes first, height and width any
multiples of 32. The scale is that of training: half of a 1280×720 picture. All of it is 640×360 and gets grey
(114) bars of 12 rows above and below; the edge daemon gives only the road's part. Output: 1×{4 + len(CLASSES)}×n, n = 5040
for 384×640; rows 0 to 3 are centre x, centre y, width and height in pixels of the input, rows 4 to
{3 + len(CLASSES)} are class scores 0..1 (after the sigmoid). No NMS inside.

## Limits
{_limits(real)} Vehicles smaller or less visible than the label rule are
found unreliably, and classes are mixed up in the distance. No curves, no junctions.

## Licence
AGPL-3.0, as is Ultralytics, the tool that trained them.
"""
