"""Learning from a teacher's answers on real pictures, and from the labels of rendered ones.

At every place of a real picture the student learns the teacher's scores and boxes as they are, so
that what the teacher is unsure of stays unsure, and, through one linear layer for each stride, what
the teacher's heads look at. The teacher sees the picture before it is worn, and at twice the size
where that shows more. Hand-made boxes that the teacher does not find are added. Rendered pictures
are learned from their labels by Ultralytics' assignment, and from what the weights answered before.

Everything that needs torch is imported inside the functions.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from edge_daemon.frame import Image, read_image
from slipstream.errors import InputError
from slipstream_lab.simulation.streetdrive.vehicles import CLASSES
from slipstream_lab.simulation.training.distillation.samples import (
    Sample,
    cut,
    halved,
    planes,
    side_by_side,
    worn,
)
from slipstream_lab.simulation.training.distillation.sources import RealCamera, of_role
from slipstream_lab.simulation.training.distillation.teacher import Answer, Teacher
from slipstream_lab.simulation.training.export import load_yolo
from slipstream_lab.simulation.training.labelled import LabelledSet
from slipstream_lab.simulation.training.metrics import Boxes, box_iou
from slipstream_lab.simulation.training.scenes import TRAIN

_REAL_ZOOM: Final = (0.6, 1.7)
_RENDERED_ZOOM: Final = (0.9, 1.15)
_REAL_STRETCH: Final = 0.2
_RENDERED_STRETCH: Final = 0.06
_RENDERED_WEAR: Final = 0.3
_SEAMS: Final = 0.3
"""Share of real samples that are two pictures side by side."""
_KNOWN_SCORE: Final = 0.35
"""A hand-made box that the teacher finds with this score is left to the teacher."""
_KNOWN_IOU: Final = 0.5
_BOX_SCORE: Final = 0.1
"""Boxes are learned where the teacher's score is this and more."""
_BOX, _CLASS, _DFL, _FEATURE = 7.5, 0.5, 1.5, 2.0
_AVERAGE: Final = 0.998
_DECAY: Final = 5e-4
_SAVE_STEPS: Final = 50


@dataclass(frozen=True)
class DistilSettings:
    """Settings of learning from a teacher.

    Attributes:
        pictures: real and rendered samples in all.
        distinct: real samples that the teacher is asked about; each is then learned several times,
            worn in other ways. They stay in memory, some 0.7 MB each.
        shape: (height, width) of a sample, multiples of 32: cuts at the daemon's scale.
        rendered_share: of a batch.
        former_share: of the weights at the end: means of weights before and after lose less on
            renders than they win on real pictures (Wortsman et al., CVPR 2022).
        every: of clips, one frame in so many is used.
    """

    pictures: int = 24_000
    distinct: int = 3000
    seed: int = 7
    batch: int = 8
    shape: tuple[int, int] = (256, 416)
    rendered_share: float = 0.5
    former_share: float = 0.4
    learning_rate: float = 8e-4
    final_rate: float = 0.02
    every: int = 5
    threads: int = 2

    @property
    def steps(self) -> int:
        """Batches in all."""
        return max(1, self.pictures // self.batch)

    @property
    def rendered(self) -> int:
        """Rendered samples of a batch."""
        return round(self.batch * self.rendered_share)


@dataclass(frozen=True)
class Batch:
    """Samples of one step; the first have an answer of the teacher, the others None.

    Attributes:
        images: worn, shape (n, 3, height, width), RGB, 0..1.
        boxes: hand-made or rendered ones of each sample, px of the sample.
    """

    images: np.ndarray[Any, np.dtype[np.float32]]
    boxes: tuple[Boxes, ...]
    answers: tuple[Answer | None, ...]


class Batches:
    """Draws batches; each is decided by the seed and its number alone."""

    def __init__(
        self,
        cameras: Sequence[RealCamera],
        rendered: Sequence[Path],
        teacher: Teacher,
        settings: DistilSettings,
    ) -> None:
        """From cameras to train on, and folders of rendered sets."""
        chosen = of_role(cameras, "train")
        self._real = [list(camera.pictures(settings.every)) for camera in chosen]
        weights = np.array([camera.weight for camera in chosen])
        self._weights = weights / weights.sum()
        self._rendered = [
            (folder, path)
            for folder in rendered
            for path in sorted((folder / "images" / TRAIN).glob("*.png"))
        ]
        if settings.rendered and not self._rendered:
            raise InputError(Path(*rendered[:1]), "no rendered pictures", "render some first")
        self._teacher = teacher
        self._settings = settings
        self._asked: dict[int, tuple[Image, Boxes, Answer]] = {}

    @property
    def real_pictures(self) -> int:
        """Real pictures that samples are cut from."""
        return sum(map(len, self._real))

    @property
    def rendered_pictures(self) -> int:
        """Rendered pictures that samples are cut from."""
        return len(self._rendered)

    def draw(self, number: int) -> Batch:
        """Batch of this number."""
        settings = self._settings
        rng = np.random.default_rng((settings.seed, 0, number))
        images: list[Image] = []
        boxes: list[Boxes] = []
        answers: list[Answer | None] = []
        for _ in range(settings.batch - settings.rendered):
            image, unknown, answer = self._real_sample(int(rng.integers(settings.distinct)))
            images.append(worn(image, rng))
            boxes.append(unknown)
            answers.append(answer)
        for _ in range(settings.rendered):
            sample = self._cut_rendered(rng)
            images.append(worn(halved(sample.fine), rng, _RENDERED_WEAR))
            boxes.append(sample.boxes)
            answers.append(None)
        return Batch(planes(images), tuple(boxes), tuple(answers))

    def _real_sample(self, number: int) -> tuple[Image, Boxes, Answer]:
        """Sample of this number with the teacher's answer and the boxes that this lacks."""
        if number not in self._asked:
            rng = np.random.default_rng((self._settings.seed, 1, number))
            sample = self._cut_real(rng)
            if rng.random() < _SEAMS:
                share = float(rng.uniform(0.3, 0.7))
                sample = side_by_side(sample, self._cut_real(rng), share)
            answer = self._teacher.answer(sample.fine, sample.detailed)
            unknown = unknown_to(answer, sample.boxes)
            self._asked[number] = halved(sample.fine), unknown, answer
        return self._asked[number]

    def _cut_real(self, rng: np.random.Generator) -> Sample:
        pictures = self._real[int(rng.choice(len(self._real), p=self._weights))]
        image, boxes = pictures[int(rng.integers(len(pictures)))]
        return cut(image, boxes, self._settings.shape, rng, _REAL_ZOOM, _REAL_STRETCH)

    def _cut_rendered(self, rng: np.random.Generator) -> Sample:
        folder, path = self._rendered[int(rng.integers(len(self._rendered)))]
        image: Image | None = read_image(path)
        if image is None:
            raise InputError(path, "not a readable picture", "render it again")
        labelled = LabelledSet(folder, CLASSES, (path,))
        boxes = labelled.boxes(path, (image.shape[1], image.shape[0]))
        return cut(image, boxes, self._settings.shape, rng, _RENDERED_ZOOM, _RENDERED_STRETCH)


def unknown_to(answer: Answer, boxes: Boxes) -> Boxes:
    """Of hand-made boxes, those that the teacher does not find itself."""
    if not len(boxes.corners):
        return boxes
    sure = answer.scores.max(axis=1) >= _KNOWN_SCORE
    overlap = box_iou(boxes.corners, answer.boxes[sure].astype(np.float64))
    keep = ~(overlap >= _KNOWN_IOU).any(axis=1)
    return Boxes(boxes.corners[keep], boxes.classes[keep], boxes.scores[keep])


def distil(initial: Path, out: Path, settings: DistilSettings, batches: Batches) -> Path:
    """Train from Ultralytics' weights and return the moving average after the last step (.pt).

    A run that was broken off in `out` is taken up again.
    """
    import torch

    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    out.mkdir(parents=True, exist_ok=True)
    yolo = load_yolo(initial)
    model = yolo.model.float().train()
    for parameter in model.parameters():
        parameter.requires_grad_(True)
    model.to(memory_format=torch.channels_last)
    average = deepcopy(model).eval()
    lessons = Lessons(model, former=deepcopy(model).eval())
    parameters = [*model.parameters(), *lessons.bridges.parameters()]
    optimizer = torch.optim.AdamW(
        [
            {"params": [p for p in parameters if p.ndim > 1], "weight_decay": _DECAY},
            {"params": [p for p in parameters if p.ndim <= 1], "weight_decay": 0.0},
        ],
        lr=settings.learning_rate,
    )
    kept = out / "distil-checkpoint.pt"
    parts = {"model": model, "average": average, "bridges": lessons.bridges, "optimizer": optimizer}
    begin = _restore(kept, parts)
    started = time.monotonic()
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(batches.draw, begin)
        for step in range(begin, settings.steps):
            batch = following.result()
            following = pool.submit(batches.draw, step + 1)
            rate = learning_rate(step, settings)
            for group in optimizer.param_groups:
                group["lr"] = rate
            figures = _step(model, lessons, optimizer, batch)
            _follow(average, model, min(_AVERAGE, (1 + step) / (20 + step)))
            if (step + 1) % _SAVE_STEPS == 0 or step + 1 == settings.steps:
                _keep(kept, parts, step + 1)
                words = ", ".join(f"{name} {value:.3f}" for name, value in figures.items())
                took = (time.monotonic() - started) / (step + 1 - begin) / settings.batch
                print(f"{step + 1}/{settings.steps}: {words}; {took:.3f} s a sample", flush=True)
    _follow(average, lessons.former, 1 - settings.former_share)
    yolo.model.load_state_dict(average.state_dict())
    weights = out / "distilled.pt"
    yolo.save(str(weights))
    return weights


def learning_rate(step: int, settings: DistilSettings) -> float:
    """A warm-up over the first fiftieth of the steps, then half a cosine down to `final_rate`."""
    warm = max(1, settings.steps // 50)
    along = step / settings.steps
    share = settings.final_rate + (1 - settings.final_rate) * (1 + np.cos(np.pi * along)) / 2
    return settings.learning_rate * float(share) * min(1.0, (step + 1) / warm)


def _step(model: Any, lessons: Lessons, optimizer: Any, batch: Batch) -> dict[str, float]:
    import torch

    images = torch.from_numpy(batch.images).contiguous(memory_format=torch.channels_last)
    # Ultralytics' loss is float; bfloat16 halves the time of a step where the processor has it.
    with torch.autocast("cpu", torch.bfloat16):
        answers = model(images)
    losses = lessons.losses(answers, batch, images)
    total = sum(losses.values())
    optimizer.zero_grad()
    total.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
    optimizer.step()
    return {name: float(value.detach()) for name, value in losses.items()}


def _follow(average: Any, model: Any, share: float) -> None:
    import torch

    with torch.no_grad():
        for mean, now in zip(
            average.state_dict().values(), model.state_dict().values(), strict=True
        ):
            if mean.dtype.is_floating_point:
                mean.lerp_(now, 1 - share)
            else:
                mean.copy_(now)


def _restore(kept: Path, parts: dict[str, Any]) -> int:
    import torch

    if not kept.is_file():
        return 0
    content = torch.load(kept, map_location="cpu", weights_only=True)
    for name, part in parts.items():
        part.load_state_dict(content[name])
    return int(content["step"])


def _keep(kept: Path, parts: dict[str, Any], step: int) -> None:
    import torch

    fresh = kept.with_suffix(".new")
    torch.save({"step": step} | {name: part.state_dict() for name, part in parts.items()}, fresh)
    shutil.move(fresh, kept)


class Lessons:
    """The losses of a student.

    Attributes:
        bridges: a linear layer for each stride, from the student's features to the teacher's.
        former: the student as it was before.
    """

    def __init__(self, model: Any, former: Any) -> None:
        """Of a model, and as it was before. The model's arguments are replaced."""
        from torch import nn
        from ultralytics.utils.loss import v8DetectionLoss

        model.args = SimpleNamespace(box=_BOX, cls=_CLASS, dfl=_DFL)
        channels = [branch[0].conv.in_channels for branch in model.model[-1].cv2]
        self.bridges = nn.ModuleList(nn.Conv2d(c, c, 1) for c in channels)
        self._own = v8DetectionLoss(model)
        self.former = former

    def losses(self, answers: dict[str, Any], batch: Batch, images: Any) -> dict[str, Any]:
        """By name, for the network's answers (in training) to a batch with these images."""
        import torch
        from ultralytics.utils.tal import make_anchors

        own = self._own
        features = [f.float() for f in answers["feats"]]
        spread = answers["boxes"].float().permute(0, 2, 1).contiguous()
        scores = answers["scores"].float().permute(0, 2, 1).contiguous()
        places, strides = make_anchors(features, own.stride, 0.5)
        boxes = own.bbox_decode(places, spread)
        labels, corners, real = _padded(batch.boxes)
        _, wanted, sure, here, _ = own.assigner(
            scores.detach().sigmoid(),
            boxes.detach() * strides,
            places * strides,
            labels,
            corners,
            real,
        )
        wanted, sure = wanted.clone(), sure.clone()
        before = self._remembered(batch, images)
        for row, answer in enumerate(batch.answers):
            if answer is None:
                put, said = before.pop(0)
            else:
                put, said = torch.from_numpy(answer.boxes), torch.from_numpy(answer.scores)
            better = said.amax(dim=1) >= sure[row].amax(dim=1)
            sure[row, better] = said[better]
            wanted[row, better] = put[better]
            here[row] = sure[row].amax(dim=1) >= _BOX_SCORE
        total = sure.sum().clamp(min=1)
        size = torch.tensor(batch.images.shape[2:], dtype=torch.float32)
        near, dfl = own.bbox_loss(
            *(spread, boxes, places, wanted / strides, sure, total, here, size, strides)
        )
        return {
            "box": _BOX * near,
            "class": _CLASS * own.bce(scores, sure).sum() / total,
            "dfl": _DFL * dfl,
            "features": _FEATURE * self._unlikeness(features, batch),
        }

    def _remembered(self, batch: Batch, images: Any) -> list[tuple[Any, Any]]:
        """Boxes (n, 4) and scores (n, classes) of the former weights for each rendered sample."""
        import torch
        from ultralytics.utils.ops import xywh2xyxy

        rows = [row for row, answer in enumerate(batch.answers) if answer is None]
        if not rows:
            return []
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
            said = self.former(images[rows])[0].float().transpose(1, 2)
        return [(xywh2xyxy(each[:, :4]), each[:, 4:]) for each in said]

    def _unlikeness(self, features: list[Any], batch: Batch) -> Any:
        """Mean squared difference of features whose channels have mean 0 and variance 1."""
        import torch

        rows = [row for row, answer in enumerate(batch.answers) if answer is not None]
        if not rows:
            return features[0].new_zeros(())
        parts = []
        for level, bridge in enumerate(self.bridges):
            seen = [a.features[level] for a in batch.answers if a is not None]
            target = _standard(torch.from_numpy(np.stack(seen).astype(np.float32)))
            parts.append((_standard(bridge(features[level][rows])) - target).square().mean())
        return sum(parts) / len(parts)


def _standard(x: Any) -> Any:
    mean = x.mean(dim=(0, 2, 3), keepdim=True)
    return (x - mean) / (x.var(dim=(0, 2, 3), keepdim=True) + 1e-4).sqrt()


def _padded(boxes: Sequence[Boxes]) -> tuple[Any, Any, Any]:
    """Classes (n, most, 1), corners (n, most, 4) and which of them are boxes (n, most, 1)."""
    import torch

    most = max((len(b.corners) for b in boxes), default=0)
    labels = torch.zeros(len(boxes), most, 1)
    corners = torch.zeros(len(boxes), most, 4)
    for row, of in enumerate(boxes):
        labels[row, : len(of.corners), 0] = torch.from_numpy(of.classes.astype(np.float32))
        corners[row, : len(of.corners)] = torch.from_numpy(of.corners.astype(np.float32))
    return labels, corners, corners.sum(dim=2, keepdim=True) > 0
