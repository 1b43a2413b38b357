"""The settings files of the edge."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args

import pytest
from pydantic import BaseModel

from edge_daemon.settings import CameraSettings, EdgeSettings, PointsSettings, TrackSettings


def models(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A settings model and those of its fields."""
    yield model
    for field in model.model_fields.values():
        for option in (field.annotation, *get_args(field.annotation)):
            if isinstance(option, type) and issubclass(option, BaseModel):
                yield from models(option)


@pytest.mark.parametrize("file", [EdgeSettings, TrackSettings, CameraSettings, PointsSettings])
def test_every_key_says_what_it_is(file: type[BaseModel]) -> None:
    """No field without a description, in whichever section, but for the constants."""
    bare = {
        f"{model.__name__}.{name}"
        for model in models(file)
        if model.__module__ == "edge_daemon.settings"
        for name, field in model.model_fields.items()
        if not field.description
    }
    assert bare <= {
        "EdgeSettings.state_interval_s",
        "EdgeSettings.watch",
        "TrackSettings.state_interval_s",
        "TrackSettings.watch",
        "WatchSettings.max_shake_share",
        "WatchSettings.max_shift_share",
        "WatchSettings.moved_after_s",
    }
