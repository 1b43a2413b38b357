"""Writes the card that travels with the shipped weights."""
# ruff: noqa: E501 (the text is Markdown)

from __future__ import annotations

from dataclasses import dataclass

from simulation.streetdrive.vehicles import CLASSES
from simulation.training.metrics import Figures
from simulation.training.scenes import MIN_HEIGHT_PX, MIN_VISIBLE_FRACTION
from simulation.training.train import WEIGHTS_NAME, TrainSettings


@dataclass(frozen=True)
class Run:
    """What a finished run measured."""

    date: str
    settings: TrainSettings
    train_pictures: int
    train_boxes: int
    held_out_pictures: int
    shipped: Figures
    validator: tuple[float, float]
    minutes: float
    versions: dict[str, str]


def card_text(run: Run) -> str:
    """The card as Markdown."""
    shipped, settings = run.shipped, run.settings
    rows = "\n".join(
        f"| {name} | {count} | {ap:.3f} |"
        for name, count, ap in zip(CLASSES, shipped.boxes, shipped.ap50, strict=True)
    )
    versions = ", ".join(f"{name} {version}" for name, version in run.versions.items())
    classes = ", ".join(f"{i} {name}" for i, name in enumerate(CLASSES))
    return f"""# {WEIGHTS_NAME}

YOLO11n, trained from random weights on StreetDrive renders only. Classes: {classes}.
Made on {run.date} by

    python -m simulation.training --images {run.train_pictures} --held-out \
{run.held_out_pictures} --epochs {settings.epochs} --seed {settings.seed} --out DIR

| file | what |
|---|---|
| `{WEIGHTS_NAME}.xml`, `.bin` | OpenVINO, static input 1×3×384×640, weights stored as FP16 |
| `{WEIGHTS_NAME}.metadata.yaml` | class names, stride, input size |
| `{WEIGHTS_NAME}.pt` | the same weights for Ultralytics, half precision, optimizer stripped |

## Data
{run.train_pictures} training pictures with {run.train_boxes} boxes and {run.held_out_pictures} held-out
pictures with {sum(shipped.boxes)} boxes, rendered at 1280×720 and reduced to 640×360. Drawn at random for
each picture: camera height (6 to 14 m), focal length, pitch, yaw, roll and place; one to three lanes a side;
density from free to jammed; vehicle shapes, sizes and paints; sun, overcast and haze; scenery, tree
shadows, pedestrians, signs, cabinets, and posts close to the camera; blur, vignette, noise, contrast,
gamma, colour cast and JPEG quality.

A vehicle is labelled when at least {MIN_VISIBLE_FRACTION:.0%} of its silhouette is visible inside the picture and its
box is at least {MIN_HEIGHT_PX:.0f} px high at 640 px picture width. Others stay in the picture unlabelled.

The held-out pictures share no random seed, no camera (height and focal length come from disjoint bins)
and no palette (paints and surfaces come from disjoint lists) with the training pictures. They chose
nothing: the weights are the moving average after the last epoch.

## Training
{settings.epochs} epochs, batch {settings.batch}, AdamW, learning rate {settings.learning_rate:g} with cosine decay, one epoch of warm-up,
rectangular batches of 384×640, no mosaic; flips, hue/saturation/value, shift and scale as augmentation.
{run.minutes:.0f} minutes on {settings.threads} CPU threads that other work shared. {versions}.

## Figures on the held-out pictures
| measured on | mAP50 | mAP50-95 |
|---|---|---|
| the shipped OpenVINO model at 384×640, own COCO-style evaluation (`simulation/training/metrics.py`) | {shipped.map50:.3f} | {shipped.map50_95:.3f} |
| the shipped `.pt`, Ultralytics' validator (rectangular, padded to 384×672) | {run.validator[0]:.3f} | {run.validator[1]:.3f} |

| class | held-out boxes | AP50 (OpenVINO) |
|---|---|---|
{rows}

Scores from 0.001 up, NMS per class at IoU 0.7, at most 300 boxes a picture, AP over 101 recall points.

## Input and output
Input: RGB, 0..1 (divide by 255 before the model; the model does not), planes first. A 1280×720 picture is scaled
to 640×360 and gets grey (114) bars of 12 rows above and below. Output: 1×{4 + len(CLASSES)}×5040; rows 0 to 3 are centre
x, centre y, width and height in pixels of the 640×384 input, rows 4 to {3 + len(CLASSES)} are class scores 0..1 (after the
sigmoid). No NMS inside.

## Limits
For StreetDrive pictures only. These weights have never seen a real camera: there, use weights trained
on COCO or on pictures of the camera in question. Vehicles smaller than the label rule are found
unreliably, and so are far trucks and buses of similar outline. No night, rain or snow.

## Licence
AGPL-3.0, as is Ultralytics, the tool that trained them.
"""
