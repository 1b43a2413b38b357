"""All settings of the edge: ``edge.toml``, ``camera.toml``, the points file of a calibration.

Imports nothing of the edge, so that a command line can take its bounds and defaults from here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.config import BusSettings, ServiceSettings, Settings, TunedSettings
from slipstream.messages import Identifier

BUILTIN_MODEL: Final = "builtin"
MAX_FPS: Final = 480.0

FramesPerSecond = Annotated[float, Field(gt=0, le=MAX_FPS, allow_inf_nan=False)]
WindowSeconds = Annotated[float, Field(ge=2.0, le=60.0)]
StateInterval = Annotated[float, Field(gt=0, le=10.0)]
Coordinate = Annotated[float, Field(ge=-1e8, le=1e8, allow_inf_nan=False)]
Pair = tuple[Coordinate, Coordinate]


class SourceSettings(Settings):
    """Where frames come from: a recorded clip or a camera (``[source]``)."""

    clip: Path | Annotated[tuple[Path, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Path of a video file, or a list of paths: one camera's clips, played in turn.",
    )
    url: str | None = Field(
        default=None,
        pattern=r"^(rtsp|rtsps|http|https)://",
        description="Address of a camera: RTSP or HTTP MJPEG.",
    )
    fps: FramesPerSecond | None = Field(
        default=None,
        description="Frames a second that a clip was filmed at, for one that does not say it, as "
        "raw H.264 or MJPEG; it goes before what the clip says.",
    )
    loop: bool = Field(default=False, description="Start a clip again at its end.")
    pace: Literal["real_time", "fast"] = Field(
        default="real_time",
        description="Speed of a clip: its own, or as fast as frames are processed.",
    )
    stall_timeout_s: Annotated[float, Field(gt=0, le=300)] = Field(
        default=5.0,
        description="A camera is connected again after so long without a frame, s.",
    )

    @property
    def clips(self) -> tuple[Path, ...]:
        """Of `clip`, in order; none for a camera."""
        return (self.clip,) if isinstance(self.clip, Path) else self.clip or ()

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.clip is None) == (self.url is None):
            raise ValueError("give either clip or url")
        if self.url is not None and (self.loop or self.pace == "fast" or self.fps is not None):
            raise ValueError("fps, loop and pace are for clips")
        return self


class DetectorSettings(Settings):
    """How vehicles are detected (``[detector]``)."""

    backend: str | None = Field(
        default=None,
        min_length=1,
        description="Detector by name: openvino, ultralytics, or one that an installed package "
        "adds. Default: the one for the type of the model file.",
    )
    model: str = Field(
        default=BUILTIN_MODEL,
        description="'builtin' (trained on renders), an OpenVINO .xml or folder, or a .pt file.",
    )
    device: Literal["CPU", "GPU", "NPU", "auto"] = Field(
        default="CPU",
        description="What OpenVINO computes on; auto: a GPU, else an NPU, else the CPU.",
    )
    threads: Annotated[int, Field(ge=0, le=1024)] = Field(
        default=0, description="Inference threads on the CPU; 0: one per core."
    )
    scale: Annotated[float, Field(gt=0, le=4)] | None = Field(
        default=None,
        description="Network pixels per frame pixel. Default: as the model was trained.",
    )


class StabilitySettings(Settings):
    """Thresholds of the stability flag and what a flag requires (``[stability]``)."""

    max_speed_cv: Annotated[float, Field(gt=0, le=1)] = Field(
        default=0.12, description="Coefficient of variation of speed, σ_v / v̄, dimensionless."
    )
    max_acceleration_variance_m2ps4: Annotated[float, Field(gt=0, le=100)] = Field(
        default=0.5, description="Variance of acceleration, m²/s⁴."
    )
    min_vehicles: Annotated[int, Field(ge=1)] = Field(
        default=3, description="Vehicles in the window."
    )
    confidence: Annotated[float, Field(ge=0, lt=1)] = Field(
        default=0.95,
        description="Probability from which on a segment is called stable, or turbulent, above "
        "0.5; 0: the values alone decide.",
    )
    keep_s: Annotated[float, Field(ge=0, le=3600)] = Field(
        default=0.0,
        description="Time that a segment stays stable while too few vehicles pass to judge it "
        "again, s; 0: not at all.",
    )

    def bare(self) -> StabilitySettings:
        """The paper's rule alone: no standard errors, no flag kept."""
        return self.model_copy(update={"confidence": 0.0, "keep_s": 0.0})

    @model_validator(mode="after")
    def _confidence_is_more_than_even(self) -> Self:
        if 0 < self.confidence <= 0.5:
            raise ValueError("confidence must be above 0.5, or 0")
        return self


class WatchSettings(TunedSettings):
    """When a camera is at fault."""

    moved_after_s: Annotated[float, Field(gt=0, le=60, allow_inf_nan=False)] = 5.0
    """`camera_moved`: time over which the median shift is taken, s."""
    max_shift_share: Annotated[float, Field(gt=0, le=0.05)] = 0.002
    """`camera_moved`: allowed shift of the road in the frame, as a share of the frame's width."""
    max_shake_share: Annotated[float, Field(gt=0, le=0.05)] = 0.004
    """`camera_moved`: how far the road may shake about that, in the median; it is taken out."""


class PreviewSettings(Settings):
    """The annotated frames for people; made only while there is a subscriber (``[preview]``)."""

    fps: Annotated[float, Field(ge=0, le=30)] = Field(
        default=2.0, description="Frames per second; 0: no preview."
    )


class TrackSettings(TunedSettings):
    """How a recorded video is processed (`slipstream track`)."""

    window_s: WindowSeconds = Field(default=10.0, description="Length of the feature window, s.")
    state_interval_s: StateInterval = 1.0
    """Time between two states of a segment, s."""
    detector: DetectorSettings = Field(default=DetectorSettings(), description="Detection.")
    stability: StabilitySettings = Field(
        default=StabilitySettings(), description="The stability flag."
    )
    watch: WatchSettings = WatchSettings()
    """Camera faults."""


class EdgeSettings(TrackSettings):
    """Settings of one roadside unit (``[edge]`` and ``[rsus.NAME]``)."""

    rsu: Identifier = Field(description="Name of this roadside unit.")
    camera: Path = Field(description="Calibration and segments: a camera.toml.")
    source: SourceSettings = Field(description="Where frames come from.")
    preview: PreviewSettings = Field(default=PreviewSettings(), description="Annotated frames.")
    bus: BusSettings = Field(default=BusSettings(), description="Connection to zenoh.")
    service: ServiceSettings = Field(
        default=ServiceSettings(), description="Metrics port and log level."
    )


class CalibrationPoint(Settings):
    """A point known both in the picture and on the road."""

    image: Pair = Field(description="(u, v) in px, origin at the top left.")
    road: Pair = Field(description="(x, y) in m, y to the left of x as on a map.")


class CalibrationLine(Settings):
    """A line along the road, of known offset: its points' x is not known."""

    offset: Coordinate = Field(description="y of the line, m.")
    image: Annotated[tuple[Pair, ...], Field(min_length=1, max_length=100)] = Field(
        description="Points seen on it, (u, v) in px."
    )


class ImageSize(Settings):
    """Size of the picture that the calibration was made on."""

    width: Annotated[int, Field(gt=0, le=65535)] = Field(description="Width, px.")
    height: Annotated[int, Field(gt=0, le=65535)] = Field(description="Height, px.")


class SegmentSettings(Settings):
    """The part of a road segment that the camera watches."""

    id: Identifier = Field(description="The road segment.")
    polygon: Annotated[tuple[Pair, ...], Field(min_length=3, max_length=100)] = Field(
        description="Outline on the road plane, m."
    )
    direction: Pair = Field(description="Direction of travel on the road plane, of any length.")
    lanes: Annotated[int, Field(ge=1, le=100)] = Field(default=1, description="Number of lanes.")
    lane_width_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] = Field(
        default=3.5, description="Width of a lane, m."
    )


Points = Annotated[
    tuple[CalibrationPoint, ...],
    Field(min_length=4, max_length=500, description="Points known in the picture and on the road."),
]


Term = Literal["lens", "arc", "crest"]
CalibrationLines = Annotated[
    tuple[CalibrationLine, ...],
    Field(max_length=50, description="Lines of known offset along the road."),
]


Masks = Annotated[
    tuple[Annotated[tuple[Pair, ...], Field(min_length=3, max_length=100)], ...],
    Field(
        max_length=16,
        description="Outlines in the picture, px, of what must not be looked at: grey from the "
        "first step on. None may cover watched road.",
    ),
]


class PointsSettings(Settings):
    """A points file: points, and what else of a camera.toml is known. A camera.toml is one too."""

    schema_version: Literal[1] = Field(default=1, alias="schema", description="File format.")
    name: str | None = Field(default=None, description="Name of the camera.")
    reference: Path | None = Field(default=None, description="Picture that the points are in.")
    image: ImageSize | None = Field(default=None, description="Size of that picture.")
    terms: tuple[Term, ...] | None = Field(
        default=None,
        description="What the view has beyond a plane and a pinhole. Default: what the points ask "
        "for.",
    )
    points: Points
    lines: CalibrationLines = ()
    masks: Masks = ()
    segments: Annotated[tuple[SegmentSettings, ...], Field(max_length=16)] = Field(
        default=(), description="Watched segments."
    )


class CameraSettings(Settings):
    """A calibrated camera and what it watches (``camera.toml``)."""

    schema_version: Literal[1] = Field(alias="schema", description="File format.")
    name: str = Field(description="Name of the camera.")
    reference: Path | None = Field(
        default=None,
        description="The picture that the calibration was made on, relative to the file.",
    )
    image: ImageSize = Field(description="Size of that picture.")
    terms: tuple[Term, ...] = Field(
        default=(),
        description="What the view has beyond a plane and a pinhole: `lens` (radial distortion), "
        "`arc` (the road bends in plan), `crest` (a vertical curve, crest or sag). With any, x is "
        "the way along the road and y the offset to its left.",
    )
    points: Points
    lines: CalibrationLines = ()
    masks: Masks = ()
    segments: Annotated[tuple[SegmentSettings, ...], Field(min_length=1, max_length=16)] = Field(
        description="Watched segments."
    )
