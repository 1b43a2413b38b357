"""Between signals and vehicles: phase and timing, priority requests, and their status.

Names and fields follow SAE J2735 (SPAT, SRM, SSM); docs/wire.md has the table.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from pydantic import Field, model_validator

from slipstream.messages.base import ROOT, Count, Identifier, Model, TimeNs, chunk

PhaseState = Literal[
    "dark",
    "stop-And-Remain",
    "pre-Movement",
    "permissive-Movement-Allowed",
    "protected-Movement-Allowed",
    "permissive-clearance",
    "protected-clearance",
]
"""MovementPhaseState. permissive: through the gaps of traffic that has priority."""

MAY_GO: Final[frozenset[PhaseState]] = frozenset(
    {"permissive-Movement-Allowed", "protected-Movement-Allowed"}
)


class MovementEvent(Model):
    """One phase of a movement, from its start to its end."""

    state: PhaseState
    start_ns: TimeNs = Field(description="Past for the one that runs; else the earliest start.")
    min_end_ns: TimeNs = Field(description="It ends no sooner.")
    max_end_ns: TimeNs | None = Field(
        description="It ends no later; equal to `min_end_ns` where the time is fixed; null: open."
    )

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        if self.max_end_ns is not None and self.max_end_ns < self.min_end_ns:
            raise ValueError("max_end_ns must not be before min_end_ns")
        return self


class MovementState(Model):
    """The running and the coming phases of one signal group, as far as they are known."""

    signal_group: Count
    events: Annotated[tuple[MovementEvent, ...], Field(min_length=1, max_length=64)]


class SignalPhaseAndTiming(Model):
    """SPAT of one intersection, sent at each change and once a second."""

    intersection: Identifier
    revision: Count
    time_ns: TimeNs
    movements: Annotated[tuple[MovementState, ...], Field(max_length=255)]


class SignalRequest(Model):
    """SRM: a vehicle asks for green."""

    vehicle: Identifier
    request: Count = Field(description="The vehicle's number of it; updates keep it.")
    sequence: Count
    time_ns: TimeNs
    intersection: Identifier
    signal_group: Count
    kind: Literal["priorityRequest", "priorityRequestUpdate", "priorityCancellation"]
    arrival_ns: TimeNs = Field(description="At the stop line, unhindered.")
    through_ns: TimeNs = Field(description="When it and its followers have passed the line.")

    @model_validator(mode="after")
    def _times_are_in_order(self) -> Self:
        if self.through_ns < self.arrival_ns:
            raise ValueError("through_ns must not be before arrival_ns")
        return self


class RequestStatus(Model):
    """What became of one request."""

    vehicle: Identifier
    request: Count
    status: Literal["requested", "processing", "granted", "rejected", "reserviceLocked"]


class SignalStatus(Model):
    """SSM: an intersection's answer to its open requests."""

    intersection: Identifier
    sequence: Count
    time_ns: TimeNs
    requests: Annotated[tuple[RequestStatus, ...], Field(max_length=255)]


def spat_key(intersection: str) -> str:
    """Key of a SignalPhaseAndTiming."""
    return f"{ROOT}/signal/{chunk(intersection)}/spat"


def signal_request_key(intersection: str, vehicle: str) -> str:
    """Key of a SignalRequest."""
    return f"{ROOT}/signal/{chunk(intersection)}/request/{chunk(vehicle)}"


def signal_status_key(intersection: str) -> str:
    """Key of a SignalStatus."""
    return f"{ROOT}/signal/{chunk(intersection)}/status"


ALL_SPAT: Final = f"{ROOT}/signal/*/spat"
ALL_SIGNAL_REQUESTS: Final = f"{ROOT}/signal/*/request/*"
