"""Messages on the bus: one pydantic model each, JSON in UTF-8, and the key expressions.

All models refuse unknown fields and wrong types, so that a message that is not what its key
promises is noticed where it arrives. Times are UTC in nanoseconds since 1970; units are in names.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self, TypeVar, get_args
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from slipstream.errors import InputError

ROOT: Final = "slipstream/v1"

Identifier = Annotated[str, Field(min_length=1, max_length=200)]
"""A name of an RSU, road segment, vehicle or order; any characters, percent-encoded in keys."""

TimeNs = Annotated[int, Field(ge=0, lt=2**63)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Message(BaseModel):
    """Base of everything on the bus."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    def to_bytes(self) -> bytes:
        """Encode as UTF-8 JSON."""
        return self.model_dump_json().encode()


M = TypeVar("M", bound=Message)


def decode(model: type[M], payload: bytes, source: str) -> M:
    """Read one message.

    Args:
        model: the message type that the key promises.
        payload: UTF-8 JSON.
        source: the key it came on, for the error line.

    Raises:
        InputError: the payload is not such a message.
    """
    try:
        return model.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"]) or None
        raise InputError(
            source, f"not a {model.__name__}: {first['msg']}", "check the sender's version", key=key
        ) from None


class Estimate(Message):
    """A measured quantity with its standard error, in the unit that its field names."""

    value: Finite
    standard_error: NonNegative | None = None


class KinematicFeatures(Message):
    """The paper's six features of a road segment over one window (paper, section V-A)."""

    mean_speed_mps: Estimate
    mean_acceleration_mps2: Estimate
    density_veh_per_m: Estimate
    speed_std_mps: Estimate
    acceleration_variance_m2ps4: Estimate
    mean_gap_m: Estimate | None = Field(
        default=None, description="None where no vehicle followed another in its lane."
    )


CameraFault = Literal[
    "stale",
    "dark",
    "bright",
    "obscured",
    "frozen",
    "corrupt",
    "camera_moved",
    "clock_jump",
]
"""Faults of a camera; its pictures are not used while one lasts."""

CAMERA_FAULTS: Final[tuple[CameraFault, ...]] = get_args(CameraFault)

UnknownReason = (
    Literal["no_frames", "too_few_vehicles", "window_not_covered", "uncertain"] | CameraFault
)
"""Why a flag is unknown."""


class SegmentState(Message):
    """What an RSU saw on one road segment in the last window.

    ``y_e`` is 1 (stable), 0 (turbulent) or None (unknown, with ``reason``). Unknown gates like 0.
    1 with fewer vehicles than a flag takes, or with none and no features, is the flag of an earlier
    window that the RSU is set to keep (`stability.keep_s`).
    """

    rsu: Identifier
    segment: Identifier
    sequence: Count
    time_ns: TimeNs = Field(description="UTC at the end of the window.")
    window_s: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    features: KinematicFeatures | None
    y_e: Literal[0, 1] | None
    reason: UnknownReason | None
    vehicles: Count = Field(description="Vehicles with a usable track.")
    frames: Count = Field(description="Frames processed in the window.")
    coverage: Annotated[float, Field(ge=0, le=1, description="Share of the window with frames.")]

    @model_validator(mode="after")
    def _flag_and_reason_agree(self) -> Self:
        if (self.y_e is None) != (self.reason is not None):
            raise ValueError("reason is given exactly when y_e is null")
        if self.features is None and (self.y_e == 0 or (self.y_e == 1 and self.vehicles > 0)):
            raise ValueError("y_e needs features, but for a stable segment that nobody came by on")
        return self


class RsuHealth(Message):
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


class PlannedSegment(Message):
    """One road segment of a vehicle's route."""

    segment: Identifier
    entry_ns: TimeNs
    exit_ns: TimeNs
    speed_mps: NonNegative
    platoon: Identifier | None = Field(description="Platoon to drive in here; None: alone.")
    place: Count | None = Field(description="0 is the leader.")
    gap_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        description="Advised gap to the vehicle ahead; None for the leader and for vehicles alone."
    )
    leg: Count = Field(description="Which leg between two stops it belongs to.")


class PlannedStop(Message):
    """One stop of a vehicle's route."""

    stop: Identifier
    node: Identifier
    arrival_ns: TimeNs
    departure_ns: TimeNs


class DrivingAdvice(Message):
    """How to drive a plan's legs, beside where and when: each part a lever of its own."""

    eco_approach: bool = Field(
        default=False, description="Time the approach to signals by what their RSU broadcasts."
    )
    coasting_budget: Annotated[float, Field(ge=0, le=0.5)] = Field(
        default=0.0,
        description="Share of a leg's planned time that coasting to turns and stops may add.",
    )
    signal_priority: bool = Field(
        default=False, description="Ask signals for green where the city allows it."
    )
    departure_window_s: Annotated[float, Field(ge=0, le=600)] = Field(
        default=0.0,
        description="A leg driven alone may begin so much later than planned, at the second that "
        "suits the signals best, s. The simulated fleet tries nine, 4 s apart.",
    )


class VehiclePlan(Message):
    """The advice that one vehicle gets from one dispatch cycle."""

    vehicle: Identifier
    cycle: Count
    issued_ns: TimeNs
    valid_until_ns: TimeNs
    depart_ns: TimeNs
    stops: tuple[PlannedStop, ...]
    segments: tuple[PlannedSegment, ...]
    distance_m: NonNegative
    energy_kwh: NonNegative
    advice: DrivingAdvice = DrivingAdvice()


class VehiclePosition(Message):
    """Where a vehicle's own telematics puts it, about once a second."""

    vehicle: Identifier
    time_ns: TimeNs
    segment: Identifier = Field(description="That it is on, or stands at one of the ends of.")
    share: Annotated[float, Field(ge=0, le=1, description="Of that segment that lies behind it.")]
    speed_mps: NonNegative
    on_road: bool = Field(description="False: it stands at a stop or at its depot.")
    cycle: Count | None = Field(
        description="Cycle of the plan that it follows; None: it is free for one."
    )
    leg: Count | None = Field(
        description="Leg of that plan that it drives, or will drive next; None: no plan."
    )

    @model_validator(mode="after")
    def _leg_has_a_plan(self) -> Self:
        if (self.cycle is None) != (self.leg is None):
            raise ValueError("leg is given exactly when cycle is")
        return self


class SolverReport(Message):
    """What one solver did in one cycle; its objective is re-evaluated, never taken over."""

    solver: Identifier
    status: Literal["optimal", "feasible", "infeasible", "timeout", "failed"]
    objective_kwh: Finite | None = Field(description="H_cost − H_platoon of the plan it led to.")
    repaired: bool = Field(description="True if post-processing was needed to get a valid plan.")
    p_feasible_raw: Annotated[float, Field(ge=0, le=1)] | None = None
    p_optimal_raw: Annotated[float, Field(ge=0, le=1)] | None = None
    p_feasible_repaired: Annotated[float, Field(ge=0, le=1)] | None = None
    qubits: Count | None = None
    shots: Count | None = None
    wall_s: NonNegative
    reason: str | None = None
    backend: str | None = Field(default=None, description="Where its quantum circuit ran.")
    backend_kind: Literal["simulated", "noise-model", "hardware"] | None = None
    fallback: str | None = Field(
        default=None, description="Why it is not the device that was asked for."
    )
    two_qubit_depth: Count | None = None


class Gate(Message):
    """Why platooning was open or closed on one watched segment in one cycle."""

    segment: Identifier
    y_e: Literal[0, 1] | None = Field(description="Flag that it was judged by; None: unknown.")
    reason: str | None = Field(
        description="Code of why it is closed. Senders of version 0.1 put 'unknown: ' before the "
        "code of an unknown flag."
    )
    age_s: NonNegative | None
    speed_mps: NonNegative | None
    open: bool


class EnergySummary(Message):
    """Physical energy of a plan set against the named baseline, and where the saving comes from."""

    baseline: str
    baseline_kwh: NonNegative
    cooperative_kwh: NonNegative
    saved_distance_kwh: Finite
    saved_drag_kwh: Finite
    saved_acceleration_kwh: Finite
    platooned_distance_m: NonNegative


class Unserved(Message):
    """A stop that no vehicle visits in this cycle's plans, and why, in words for people."""

    stop: Identifier
    reason: str


class CycleReport(Message):
    """One dispatch cycle as the dashboard and the supervisor see it."""

    cycle: Count
    started_ns: TimeNs
    wall_s: NonNegative
    status: Literal["ok", "baseline", "failed"]
    reason: str | None
    solver: Identifier | None
    objective_kwh: Finite | None
    variables: Count
    solvers: tuple[SolverReport, ...]
    gates: tuple[Gate, ...]
    energy: EnergySummary | None
    plans: Count = Field(description="Plans stored and published.")
    unserved: tuple[Unserved, ...] = Field(
        default=(), description="Stops that no plan visits; senders before this field left none."
    )


class HardwareHealth(Message):
    """How the dispatcher stands with its quantum device."""

    backend: str
    pending: Count = Field(description="Jobs that the service has, or may have.")
    used_s: NonNegative = Field(description="Device time charged or reserved in the last day.")
    budget_s: NonNegative
    breaker: Literal["closed", "open", "half-open"]
    line: str | None = Field(description="Why no job would be submitted now; null: one would.")


class DispatcherHealth(Message):
    """How the dispatcher is doing; counters run from its start."""

    time_ns: TimeNs
    started_ns: TimeNs
    cycles: Count
    cycles_failed: Count
    states_received: Count
    bad_messages: Count
    states_refused: Count = Field(
        default=0, description="States that were read and not admitted; senders before: 0."
    )
    messages_lost: Count = Field(
        default=0, description="Messages too large, or too many to handle; senders before: 0."
    )
    next_cycle_ns: TimeNs | None
    rss_mb: NonNegative
    hardware: HardwareHealth | None = Field(default=None, description="Null without a device.")
    stale_after_s: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = Field(
        default=None,
        description="Age above which its gates ignore a SegmentState, s; senders before this field "
        "left null.",
    )
    future_tolerance_s: NonNegative | None = Field(
        default=None,
        description="How far ahead of its clock a SegmentState may be dated for its gates to use "
        "it, s; senders before this field left null.",
    )


def _chunk(name: str) -> str:
    """One chunk of a key expression: percent-encoded, as zenoh forbids ``* $ ? # /`` in chunks."""
    return quote(name, safe="")


def state_key(rsu: str, segment: str) -> str:
    """Key of a SegmentState."""
    return f"{ROOT}/rsu/{_chunk(rsu)}/segment/{_chunk(segment)}/state"


def rsu_health_key(rsu: str) -> str:
    """Key of an RsuHealth."""
    return f"{ROOT}/rsu/{_chunk(rsu)}/health"


def preview_key(rsu: str) -> str:
    """Key of an RSU's annotated preview picture (JPEG bytes)."""
    return f"{ROOT}/rsu/{_chunk(rsu)}/preview"


def plan_key(vehicle: str) -> str:
    """Key of a VehiclePlan."""
    return f"{ROOT}/fleet/{_chunk(vehicle)}/plan"


def position_key(vehicle: str) -> str:
    """Key of a VehiclePosition."""
    return f"{ROOT}/fleet/{_chunk(vehicle)}/position"


ALL_STATES: Final = f"{ROOT}/rsu/*/segment/*/state"
ALL_RSU_HEALTH: Final = f"{ROOT}/rsu/*/health"
ALL_PREVIEWS: Final = f"{ROOT}/rsu/*/preview"
ALL_PLANS: Final = f"{ROOT}/fleet/*/plan"
ALL_POSITIONS: Final = f"{ROOT}/fleet/*/position"
CYCLE_KEY: Final = f"{ROOT}/dispatcher/cycle"
DISPATCHER_HEALTH_KEY: Final = f"{ROOT}/dispatcher/health"
