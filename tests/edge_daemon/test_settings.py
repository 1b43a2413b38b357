"""The settings files of the edge."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from edge_daemon.settings import CameraSettings, EdgeSettings, PointsSettings, TrackSettings
from slipstream.config import Settings, load

FORMER = """
rsu = "rsu-1"
camera = "camera.toml"
window_s = 12.0
every_s = 0.5

[source]
url = "rtsp://192.168.1.20:554/stream1"
stall_s = 7.0

[detector]
min_score = 0.2
max_overlap = 0.4

[tracker]
sure_score = 0.6

[stability]
sure_sigmas = 2.0
keep_s = 60.0

[watch]
sample_s = 0.25
moved_share = 0.005
"""
PRESENT_BY_FORMER = {
    "every_s": "state_interval_s",
    "stall_s": "stall_timeout_s",
    "max_overlap": "nms_iou",
    "sure_score": "high_score",
    "sure_sigmas": "confidence_sigmas",
    "sample_s": "sample_interval_s",
    "moved_share": "max_shift_share",
}


def models(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A settings model and those of its fields."""
    yield model
    for field in model.model_fields.values():
        for option in (field.annotation, *get_args(field.annotation)):
            if isinstance(option, type) and issubclass(option, BaseModel):
                yield from models(option)


def test_a_file_with_every_former_key_loads_as_one_with_the_present_keys(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """An RSU's file of the version before still works, with one line a former key."""
    known = {
        former: present
        for model in models(EdgeSettings)
        if issubclass(model, Settings)
        for former, present in model.renamed.items()
    }
    assert known == PRESENT_BY_FORMER
    former, present = tmp_path / "former.toml", tmp_path / "present.toml"
    former.write_text(FORMER)
    text = FORMER
    for old, new in PRESENT_BY_FORMER.items():
        assert f"\n{old} = " in text
        text = text.replace(f"\n{old} = ", f"\n{new} = ")
    present.write_text(text)
    with caplog.at_level(logging.WARNING):
        assert load(former, EdgeSettings) == load(present, EdgeSettings)
    lines = [record.getMessage() for record in caplog.records]
    assert len(lines) == len(PRESENT_BY_FORMER)
    assert all("deprecated" in line and str(former) in line for line in lines)


@pytest.mark.parametrize("file", [EdgeSettings, TrackSettings, CameraSettings, PointsSettings])
def test_every_key_says_what_it_is(file: type[BaseModel]) -> None:
    """No field without a description, in whichever section."""
    bare = {
        f"{model.__name__}.{name}"
        for model in models(file)
        if model.__module__ == "edge_daemon.settings"
        for name, field in model.model_fields.items()
        if not field.description
    }
    assert bare == set()
