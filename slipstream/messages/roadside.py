"""What a roadside unit tells: the state of its segments, its own health, its pictures."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal, get_args

from msgspec import Meta
from pydantic import Field

from slipstream.messages.base import (
    ROOT,
    Compact,
    Count,
    Finite,
    Identifier,
    Model,
    NonNegative,
    Positive,
    Share,
    TimeNs,
    chunk,
)


class Estimate(Compact, frozen=True, kw_only=True):
    """A measured quantity with its standard error, in the unit that its field names."""

    value: Finite
    standard_error: NonNegative | None = None


class KinematicFeatures(Compact, frozen=True, kw_only=True):
    """The paper's six features of a road segment over one window (paper, section V-A)."""

    mean_speed_mps: Estimate
    mean_acceleration_mps2: Estimate
    density_veh_per_m: Estimate
    speed_std_mps: Estimate
    acceleration_variance_m2ps4: Estimate
    mean_gap_m: Annotated[
        Estimate | None, Meta(description="None where no vehicle followed another in its lane.")
    ] = None


CameraFault = Literal[
    "stale",
    "dark",
    "bright",
    "obscured",
    "frozen",
    "corrupt",
    "camera_moved",
    "clock_jump",
    "blind",
]
"""Faults of a camera; its pictures are not used while one lasts."""

CAMERA_FAULTS: Final[tuple[CameraFault, ...]] = get_args(CameraFault)

UnknownReason = (
    Literal[
        "no_frames",
        "low_frame_rate",
        "window_not_covered",
        "too_few_vehicles",
        "implausible",
        "opposite_direction",
        "wrong_way",
        "uncertain",
    ]
    | CameraFault
)
"""Why a flag is unknown. `implausible`: accelerations that no traffic has were measured;
`opposite_direction`: all vehicles drive against the segment as the calibration has it;
`wrong_way`: one does, where the others have driven along it."""


class SegmentState(Compact, frozen=True, kw_only=True):
    """What an RSU saw on one road segment in the last window.

    ``y_e`` is 1 (stable), 0 (turbulent) or None (unknown, with ``reason``). Unknown gates like 0.
    1 with fewer vehicles than a flag takes, or with none and no features, is the flag of an earlier
    window that the RSU is set to keep (`stability.keep_s`).
    """

    rsu: Identifier
    segment: Identifier
    sequence: Annotated[
        Count,
        Meta(
            description="Number among all states of its RSU since that started; receivers count "
            "gaps."
        ),
    ]
    time_ns: Annotated[TimeNs, Meta(description="UTC at the end of the window.")]
    window_s: Positive
    features: KinematicFeatures | None
    y_e: Literal[0, 1] | None
    reason: UnknownReason | None
    vehicles: Annotated[Count, Meta(description="Vehicles with a usable track.")]
    frames: Annotated[Count, Meta(description="Frames processed in the window.")]
    coverage: Annotated[Share, Meta(description="Share of the window with frames.")]
    p_stable: Annotated[
        Share | None,
        Meta(
            description="Probability that the traffic is stable, by which y_e is decided; null: "
            "nothing tells it."
        ),
    ] = None

    def __post_init__(self) -> None:
        if (self.y_e is None) != (self.reason is not None):
            raise ValueError("reason is given exactly when y_e is null")
        if self.features is None and (self.y_e == 0 or (self.y_e == 1 and self.vehicles > 0)):
            raise ValueError("y_e needs features, but for a stable segment that nobody came by on")


STANDS_LONG_S: Final = 180.0
"""Longer than a red light of the scenarios: three other phases of 50 s, and their yellow."""


class StoppedVehicle(Model):
    """A vehicle that stands on a road segment."""

    lane: Count = Field(description="From the right edge of what the camera watches, from 0.")
    along_m: NonNegative = Field(
        description="Distance of its middle from the upstream end of what the camera watches."
    )
    since_ns: TimeNs = Field(description="UTC at which it came to stand, or was first seen.")
    seen_ns: TimeNs = Field(description="UTC at which it was last seen; earlier while hidden.")


class StoppedVehicles(Model):
    """All vehicles that stand on one road segment.

    Sent with each SegmentState while there is one, and once more, empty, when there is none. In a
    queue many stand: ``y_e`` and the mean speed, those of the state, tell it from a breakdown.
    """

    rsu: Identifier
    segment: Identifier
    time_ns: TimeNs
    vehicles: Annotated[tuple[StoppedVehicle, ...], Field(max_length=500)]
    y_e: Literal[0, 1] | None
    mean_speed_mps: NonNegative | None = Field(
        description="Of all vehicles in the state's window; None where none was measured."
    )

    @property
    def unusual(self) -> tuple[StoppedVehicle, ...]:
        """Those that no red light explains, the longest first.

        All where traffic is stable; else those that have stood for `STANDS_LONG_S`.
        """
        until_ns = self.time_ns - (0 if self.y_e == 1 else round(STANDS_LONG_S * 1e9))
        vehicles = (vehicle for vehicle in self.vehicles if vehicle.since_ns <= until_ns)
        return tuple(sorted(vehicles, key=lambda vehicle: vehicle.since_ns))


QUARTER_HOUR_S: Final = 900.0
MIN_WATCHED_S: Final = 60.0
"""Over less no flow is told: traffic signals let vehicles come in bunches."""

CountedClass = Literal["car", "truck", "bus", "motorcycle"]
"""As detectors tell them apart; a van is a car."""

UnwatchedReason = CameraFault | Literal["no_frames", "low_frame_rate", "not_running"]
"""Why nobody watched. `not_running`: the RSU had not started yet."""


class ClassCount(Compact, frozen=True, kw_only=True):
    """Vehicles of one class that passed while somebody watched."""

    vehicle_class: CountedClass
    vehicles: Annotated[
        Estimate, Meta(description="Its standard error is that of counting and of classing them.")
    ]


class SegmentCounts(Compact, frozen=True, kw_only=True):
    """Vehicles that passed the middle of the watched part of a segment in one quarter hour.

    Sent when the quarter hour is over (`complete`), and each minute while it runs. Only vehicles
    that passed while somebody watched are counted; nothing is added for the time when nobody did.
    """

    rsu: Identifier
    segment: Identifier
    began_ns: Annotated[TimeNs, Meta(description="UTC, a full quarter hour.")]
    until_ns: Annotated[TimeNs, Meta(description="UTC up to which it tells; its end if complete.")]
    complete: bool
    watched_s: Annotated[
        NonNegative,
        Meta(description="Of this time, how long frames came and the camera had no fault."),
    ]
    reason: Annotated[
        UnwatchedReason | None,
        Meta(description="What kept the RSU from watching for longest; null: nothing did."),
    ]
    vehicles: Annotated[
        Estimate, Meta(description="Of all classes, with the standard error of counting them.")
    ]
    classes: Annotated[
        tuple[ClassCount, ...], Meta(max_length=4, description="Each class, with 0 too.")
    ]
    mean_speed_mps: Annotated[
        Estimate | None,
        Meta(description="Arithmetic mean of the speeds at the passage; null: none was measured."),
    ]
    v85_mps: Annotated[
        Estimate | None,
        Meta(description="85 % of them were no faster; null: fewer than 10 were measured."),
    ]
    speeds: Annotated[Count, Meta(description="Vehicles whose speed was measured.")]

    def __post_init__(self) -> None:
        if self.began_ns % round(QUARTER_HOUR_S * 1e9):
            raise ValueError("began_ns is no full quarter hour")
        if not self.began_ns < self.until_ns <= self.began_ns + round(QUARTER_HOUR_S * 1e9):
            raise ValueError("until_ns is not in its quarter hour")
        if self.complete and self.until_ns != self.began_ns + round(QUARTER_HOUR_S * 1e9):
            raise ValueError("a complete quarter hour ends with it")

    @property
    def elapsed_s(self) -> float:
        """From its begin to the moment up to which it tells, s."""
        return (self.until_ns - self.began_ns) / 1e9

    def flow_vph(self, vehicles: Estimate) -> Estimate | None:
        """Vehicles an hour of watched time, of a count of these; None under `MIN_WATCHED_S`.

        The standard error is that of the whole elapsed time T's flow: where only W of it was
        watched, n vehicles that come independently add n (T - W) / T to the variance of the count.
        """
        watched_s, elapsed_s = self.watched_s, self.elapsed_s
        if watched_s < MIN_WATCHED_S:
            return None
        unwatched = max(0.0, elapsed_s - watched_s) / elapsed_s
        error = vehicles.standard_error
        if error is not None:
            error = math.sqrt(error**2 + max(1.0, vehicles.value) * unwatched)
            error *= 3600.0 / watched_s
        return Estimate(value=3600.0 * vehicles.value / watched_s, standard_error=error)


class StabilityLimits(Model):
    """What an RSU holds traffic against; one limit crossed, and it is turbulent."""

    max_speed_cv: NonNegative = Field(
        description="Coefficient of variation of speed, dimensionless."
    )
    max_acceleration_variance_m2ps4: NonNegative


class CameraCalibration(Model):
    """How well an RSU's camera measures, as its edge daemon finds it from its file at its start."""

    file: str = Field(description="The camera.toml.")
    written_ns: TimeNs = Field(description="UTC at which that file was last written.")
    points: Count = Field(description="Points known in the picture and on the road.")
    residual_px: NonNegative = Field(description="Root mean square over the points.")
    speed_error: NonNegative | None = Field(
        description="Relative standard error of a speed that the points leave, at the worst end of "
        "a watched segment; null: it cannot be stated."
    )


class RsuHealth(Model):
    """How an edge daemon is doing; counters run from its start."""

    rsu: Identifier
    time_ns: TimeNs
    started_ns: TimeNs
    source: str
    segments: tuple[Identifier, ...]
    status: Literal["ok", "no_signal", "ended"]
    fault: CameraFault | None = Field(
        default=None, description="Why its camera cannot be trusted now; its flags are unknown."
    )
    frames: Count
    frames_skipped: Count
    frames_repeated: Count = Field(
        default=0, description="Left out as they show the frame before once more."
    )
    decode_errors: Count
    reconnects: Count
    states: Count
    fps: NonNegative
    latency_ms_p50: NonNegative | None = Field(
        description="Frame captured to tracks updated, over the last ten seconds."
    )
    latency_ms_p95: NonNegative | None
    vehicles_in_view: Count
    rss_mb: NonNegative
    stability: StabilityLimits | None = None
    calibration: CameraCalibration | None = None


def state_key(rsu: str, segment: str) -> str:
    """Key of a SegmentState."""
    return f"{ROOT}/rsu/{chunk(rsu)}/segment/{chunk(segment)}/state"


def segment_states_key(segment: str) -> str:
    """Key expression of the SegmentStates of one segment, from any RSU."""
    return f"{ROOT}/rsu/*/segment/{chunk(segment)}/state"


def stopped_key(rsu: str, segment: str) -> str:
    """Key of a StoppedVehicles."""
    return f"{ROOT}/rsu/{chunk(rsu)}/segment/{chunk(segment)}/stopped"


def counts_key(rsu: str, segment: str) -> str:
    """Key of a complete SegmentCounts."""
    return f"{ROOT}/rsu/{chunk(rsu)}/segment/{chunk(segment)}/counts"


def running_counts_key(rsu: str, segment: str) -> str:
    """Key of the SegmentCounts of the running quarter hour."""
    return f"{counts_key(rsu, segment)}/running"


def rsu_health_key(rsu: str) -> str:
    """Key of an RsuHealth."""
    return f"{ROOT}/rsu/{chunk(rsu)}/health"


def preview_key(rsu: str) -> str:
    """Key of an RSU's annotated preview picture (JPEG bytes)."""
    return f"{ROOT}/rsu/{chunk(rsu)}/preview"


def bare_preview_key(rsu: str) -> str:
    """Key of the same picture without boxes and labels."""
    return f"{preview_key(rsu)}/bare"


ALL_STATES: Final = f"{ROOT}/rsu/*/segment/*/state"
ALL_STOPPED: Final = f"{ROOT}/rsu/*/segment/*/stopped"
ALL_COUNTS: Final = f"{ROOT}/rsu/*/segment/*/counts"
ALL_RUNNING_COUNTS: Final = f"{ALL_COUNTS}/running"
ALL_RSU_HEALTH: Final = f"{ROOT}/rsu/*/health"
ALL_PREVIEWS: Final = f"{ROOT}/rsu/*/preview"
