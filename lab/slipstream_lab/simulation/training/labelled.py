"""Labelled pictures in the YOLO layout: a data.yaml, folders of pictures, a text file for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from edge_daemon.detection.protocol import vehicle_class_of
from slipstream.errors import InputError
from slipstream.files import read_text
from slipstream_lab.simulation.training.metrics import Boxes

_MAX_BYTES: Final = 64_000_000
_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".webp"})


@dataclass(frozen=True)
class LabelledSet:
    """One split of a labelled set."""

    data: Path
    names: tuple[str, ...]
    pictures: tuple[Path, ...]

    def boxes(self, picture: Path, size: tuple[int, int]) -> Boxes:
        """True boxes of a picture of (width, height), px; other things than vehicles are left out.
        Raises InputError: a line of its label file is no box.
        """
        path = label_of(picture)
        rows = []
        if path.is_file():
            for number, line in enumerate(read_text(path, _MAX_BYTES).splitlines(), start=1):
                if line.strip():
                    rows.append(_row(line, len(self.names), path, number))
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        classes = vehicle_class_of(list(self.names), self.data)[table[:, 0].astype(np.int64)]
        half = table[:, 3:5] / 2
        corners = np.column_stack([(table[:, 1:3] - half) * size, (table[:, 1:3] + half) * size])
        keep = classes >= 0
        return Boxes(corners[keep], classes[keep], np.ones(int(keep.sum())))


def label_of(picture: Path) -> Path:
    """The label file of a picture: the last folder `images` in its path becomes `labels`."""
    parts = list(picture.with_suffix(".txt").parts)
    for place in range(len(parts) - 2, -1, -1):
        if parts[place] == "images":
            parts[place] = "labels"
            break
    return Path(*parts)


def read_labelled_set(data: Path, split: str = "val") -> LabelledSet:
    """Read a split of a data.yaml and find its pictures. Raises InputError: the file, the split or
    its pictures are missing, or no class is a vehicle.
    """
    content = _read_yaml(data)
    names = content.get("names")
    if isinstance(names, dict):
        names = [names[key] for key in sorted(names)]
    if not isinstance(names, list) or not names:
        raise InputError(data, "no class names", "list them", key="names")
    root = data.parent / str(content.get("path") or "")
    entries = content.get(split)
    if not entries:
        raise InputError(data, "no such split", "name its folder of pictures", key=split)
    pictures: set[Path] = set()
    for entry in entries if isinstance(entries, list) else [entries]:
        pictures.update(_pictures(root / str(entry), data, split))
    vehicle_class_of([str(name) for name in names], data)
    return LabelledSet(data, tuple(str(name) for name in names), tuple(sorted(pictures)))


def _read_yaml(path: Path) -> dict[str, Any]:
    import yaml

    try:
        content = yaml.safe_load(read_text(path, _MAX_BYTES))
    except yaml.YAMLError:
        raise InputError(path, "not YAML", "give a data.yaml in the YOLO layout") from None
    if not isinstance(content, dict):
        raise InputError(path, "no data.yaml", "give path, train, val and names")
    return content


def _pictures(place: Path, data: Path, split: str) -> Sequence[Path]:
    """The pictures of a folder, or those that a text file lists."""
    if place.is_dir():
        found = [p for p in place.rglob("*") if p.suffix.lower() in _SUFFIXES]
    elif place.is_file():
        lines = (line.strip() for line in read_text(place, _MAX_BYTES).splitlines())
        found = [place.parent / line for line in lines if line]
    else:
        raise InputError(data, f"no such folder: {place}", "mend the path", key=split)
    if not found:
        raise InputError(data, f"no pictures in {place}", "mend the path", key=split)
    return found


def _row(line: str, classes: int, path: Path, number: int) -> list[float]:
    try:
        row = [float(word) for word in line.split()]
    except ValueError:
        row = []
    if len(row) != 5 or not np.isfinite(row).all() or row[0] not in range(classes):
        raise InputError(
            path, "no box", "give class, centre x, y, width, height", key=f"line {number}"
        )
    return row
