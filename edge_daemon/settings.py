"""Settings of the edge daemon (``edge.toml``)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from edge_daemon.detection import DetectorSettings
from edge_daemon.sources import SourceSettings
from edge_daemon.stability import StabilitySettings
from edge_daemon.tracking import TrackerSettings
from edge_daemon.watch import WatchSettings
from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.messages import Identifier


class PreviewSettings(Settings):
    """The annotated picture for people; made only while somebody looks."""

    fps: Annotated[float, Field(ge=0, le=30)] = Field(default=2.0, description="0: none.")
    width: Annotated[int, Field(ge=160, le=1920)] = 640
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] = 70


class EdgeSettings(Settings):
    """Everything that one roadside unit needs to know."""

    rsu: Identifier = Field(description="Name of this roadside unit.")
    camera: Path = Field(description="Calibration and segments: a camera.toml.")
    source: SourceSettings
    window_s: Annotated[float, Field(ge=2.0, le=60.0)] = 10.0
    every_s: Annotated[float, Field(gt=0, le=10.0)] = Field(
        default=1.0, description="Time between two states of a segment."
    )
    detector: DetectorSettings = DetectorSettings()
    tracker: TrackerSettings = TrackerSettings()
    stability: StabilitySettings = StabilitySettings()
    watch: WatchSettings = WatchSettings()
    preview: PreviewSettings = PreviewSettings()
    bus: BusSettings = BusSettings()
    service: ServiceSettings = ServiceSettings()
