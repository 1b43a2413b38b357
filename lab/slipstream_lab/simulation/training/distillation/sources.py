"""Real cameras: which files show them, who made these, and what may be done with them."""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, get_args

import cv2
import numpy as np

from edge_daemon.frame import Image, read_image
from slipstream.errors import InputError
from slipstream.files import read_text
from slipstream_lab.simulation.training.labelled import LabelledSet
from slipstream_lab.simulation.training.metrics import Boxes

SOURCES: Final = Path(__file__).with_name("sources.toml")
Role = Literal["train", "validation", "test"]
_KEYS: Final = frozenset(
    {"name", "files", "labels", "aspect", "source", "licence", "role", "weight"}
)
_NEEDED: Final = ("name", "files", "source", "licence", "role")
_MAX_BYTES: Final = 1_000_000
_CALIBRATION_EVERY: Final = 15
_FIELD_ASPECT: Final = 2.2
"""A video wider than this is one field of an interlaced one: each of its lines stands for two."""


@dataclass(frozen=True)
class RealCamera:
    """One camera, or several of one source that are never divided by role.

    Attributes:
        files: pictures, or clips.
        labels: class names of the hand-made labels beside the pictures; None without any.
        aspect: width over height of the scene, where the files are squeezed; else None.
        weight: how often its pictures are drawn, against the other cameras'.
    """

    name: str
    files: tuple[Path, ...]
    source: str
    licence: str
    role: Role
    labels: tuple[str, ...] | None = None
    aspect: float | None = None
    weight: float = 1.0

    def pictures(self, every: int = 1) -> Iterator[tuple[Image, Boxes | None]]:
        """Pictures (height, width, 3), BGR, with their hand-made boxes in px, None without labels.

        Of clips, one frame in so many. Raises InputError: a file or its labels are unreadable.
        """
        for path in self.files:
            if path.suffix.lower() == ".mp4":
                for frame in _frames(path, every):
                    yield self._upright(frame), None
                continue
            image = read_image(path)
            if image is None:
                raise InputError(path, "not a readable picture", "remove it")
            image = self._upright(image)
            boxes = None
            if self.labels is not None:
                labelled = LabelledSet(path, self.labels, (path,))
                boxes = labelled.boxes(path, (image.shape[1], image.shape[0]))
            yield image, boxes

    def _upright(self, image: Image) -> Image:
        height, width = image.shape[:2]
        if self.aspect is not None:
            height = round(width / self.aspect)
        elif width > _FIELD_ASPECT * height:
            width = width // 2
        if (height, width) == image.shape[:2]:
            return image
        resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        return np.asarray(resized, dtype=np.uint8)


def read_sources(folder: Path, sources: Path = SOURCES) -> tuple[RealCamera, ...]:
    """The cameras of a file like `sources.toml`, with their files in the folder.

    Raises InputError: the file is no such list, a camera has no file, or a file has two cameras.
    """
    try:
        content = tomllib.loads(read_text(sources, _MAX_BYTES))
    except tomllib.TOMLDecodeError as error:
        raise InputError(sources, f"not TOML: {error}", "mend it") from None
    cameras = tuple(
        _camera(row, number, folder, sources)
        for number, row in enumerate(content.get("camera", []), start=1)
    )
    if not any(camera.role == "train" for camera in cameras):
        raise InputError(sources, "no camera to train on", "list some", key="camera")
    owner: dict[Path, str] = {}
    for camera in cameras:
        for path in camera.files:
            if path in owner:
                mend = "give each camera its own files"
                where = f"{owner[path]}, {camera.name}"
                raise InputError(sources, f"two cameras have {path.name}", mend, key=where)
            owner[path] = camera.name
    return cameras


def of_role(cameras: Iterable[RealCamera], *roles: Role) -> tuple[RealCamera, ...]:
    """The cameras of some roles."""
    return tuple(camera for camera in cameras if camera.role in roles)


def mixed_pictures(out: Path, rendered: Path, cameras: Iterable[RealCamera]) -> Path:
    """A folder with pictures of both kinds in equal numbers, for INT8 to be fitted to."""
    out.mkdir(parents=True, exist_ok=True)
    paths = sorted(rendered.glob("*.png"))
    for path in paths:
        shutil.copyfile(path, out / path.name)
    train = of_role(cameras, "train")
    for number, camera in enumerate(train):
        wanted = -(-len(paths) // len(train))
        pictures = [image for image, _ in camera.pictures(_CALIBRATION_EVERY)]
        for index in np.linspace(0, len(pictures) - 1, min(wanted, len(pictures))).astype(int):
            cv2.imwrite(str(out / f"real-{number}-{index}.png"), pictures[index])
    return out


def _camera(row: dict[str, Any], number: int, folder: Path, sources: Path) -> RealCamera:
    key = str(row.get("name", f"camera {number}"))
    missing = [name for name in _NEEDED if not row.get(name)]
    if missing:
        raise InputError(sources, f"no {missing[0]}", "name it", key=key)
    if unknown := sorted(set(row) - _KEYS):
        raise InputError(sources, f"unknown key {unknown[0]}", "remove it", key=key)
    if row["role"] not in get_args(Role):
        raise InputError(
            sources, f"no such role: {row['role']}", f"give {', '.join(get_args(Role))}", key=key
        )
    files = sorted({path for pattern in row["files"] for path in folder.glob(pattern)})
    if not files:
        raise InputError(folder, f"no file like {row['files'][0]}", f"see {sources}", key=key)
    labels = row.get("labels")
    return RealCamera(
        **{**row, "files": tuple(files), "labels": None if labels is None else tuple(labels)}
    )


def _frames(clip: Path, every: int) -> Iterator[Image]:
    capture = cv2.VideoCapture(str(clip), cv2.CAP_FFMPEG)
    try:
        number = 0
        while capture.grab():
            if number % every == 0:
                ok, image = capture.retrieve()
                if not ok:
                    break
                yield np.asarray(image, dtype=np.uint8)
            number += 1
    finally:
        capture.release()
    if number == 0:
        raise InputError(clip, "not a readable video", "copy it again")
