"""Which of RSUs' messages are admitted: a listed RSU's whose figures are physically possible.

The dispatcher's gates and the dashboard's map admit the same states.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

from pydantic import Field

from slipstream.errors import InputError, refuse
from slipstream.messages import (
    Estimate,
    Identifier,
    SegmentCounts,
    SegmentState,
    StoppedVehicles,
)
from slipstream.roads.network import RoadNetwork, Segment

Rsus = dict[Identifier, Annotated[tuple[Identifier, ...], Field(min_length=1)]]
"""The segments that each RSU watches."""

LIMITS: Final[Mapping[str, tuple[float, float]]] = {
    "mean_speed_mps": (-3.0, 70.0),
    "mean_acceleration_mps2": (-20.0, 20.0),
    "density_veh_per_m": (0.0, 2.0),
    "speed_std_mps": (0.0, 50.0),
    "acceleration_variance_m2ps4": (0.0, 400.0),
    "mean_gap_m": (-5.0, 5000.0),
}
"""Physically possible values of the features; a queue's measured speed and gap may be below 0."""
MAX_STANDARD_ERROR: Final = 1e4
MAX_WINDOW_S: Final = 3600.0
MAX_VEHICLES: Final = 10_000
_MAX_FLOW_HZ: Final = 1.0
"""Vehicles a second and lane: under half of it is the most that was ever counted."""
_MAX_LANES: Final = 30
_MAX_ALONG_M: Final = 5000.0
_SPEEDING: Final = 2.0
_SPEEDING_MPS: Final = 15.0
"""A mean speed above so many times the limit, and so much above it, belongs to another road."""


def check_rsus(
    rsus: Mapping[str, tuple[str, ...]] | None, network: RoadNetwork, source: str | Path
) -> None:
    """Check that the network has the listed segments.

    Raises:
        InputError: it lacks one.
    """
    refuse(
        InputError(
            source,
            f"the network has no segment {segment}",
            "give ids of the network's segments",
            key=f"rsus.{rsu}",
        )
        for rsu, segments in (rsus or {}).items()
        for segment in segments
        if segment not in network.segments
    )


class Refusal(NamedTuple):
    """Why a message is not admitted.

    Attributes:
        kind: the check that it failed.
        text: the reason, for people.
    """

    kind: Literal["unknown_segment", "unlisted", "implausible"]
    text: str


def refusal(
    message: SegmentState | StoppedVehicles | SegmentCounts,
    network: RoadNetwork,
    rsus: Mapping[str, Collection[str]] | None,
) -> Refusal | None:
    """Why a state, counts, or the vehicles that stand, are not admitted; None if they are.

    Args:
        rsus: the segments that each RSU may report on; None: any RSU may report on any segment.
    """
    segment = network.segments.get(message.segment)
    if segment is None:
        return Refusal("unknown_segment", "unknown segment")
    if rsus is not None and message.segment not in rsus.get(message.rsu, ()):
        return Refusal("unlisted", "its RSU is not listed for this segment")
    if isinstance(message, SegmentState):
        impossible = implausibility(message, segment)
    elif isinstance(message, SegmentCounts):
        impossible = _counts_implausibility(message, segment)
    else:
        impossible = _stopped_implausibility(message, segment)
    return None if impossible is None else Refusal("implausible", impossible)


def implausibility(state: SegmentState, segment: Segment) -> str | None:
    """What is physically impossible in a state of ``segment``; None if nothing is."""
    if state.window_s > MAX_WINDOW_S:
        return f"a window of {state.window_s:g} s"
    if state.vehicles > MAX_VEHICLES:
        return f"{state.vehicles} vehicles"
    if state.frames == 0 and (state.y_e is not None or state.vehicles):
        return "vehicles or a flag without a frame"
    if state.features is None:
        return None
    for name, (low, high) in LIMITS.items():
        estimate: Estimate | None = getattr(state.features, name)
        if estimate is None:
            continue
        if not low <= estimate.value <= high:
            return f"{name} = {estimate.value:g}"
        if (estimate.standard_error or 0.0) > MAX_STANDARD_ERROR:
            return f"{name} with a standard error of {estimate.standard_error:g}"
    return _speeding(state.features.mean_speed_mps.value, segment)


def _stopped_implausibility(stopped: StoppedVehicles, segment: Segment) -> str | None:
    """What is physically impossible in the vehicles that stand on ``segment``."""
    for vehicle in stopped.vehicles:
        if not vehicle.since_ns <= vehicle.seen_ns <= stopped.time_ns:
            return "a vehicle that was seen before it stood, or later than now"
        if vehicle.lane >= _MAX_LANES or vehicle.along_m > _MAX_ALONG_M:
            return f"a vehicle in lane {vehicle.lane + 1}, {vehicle.along_m:.4g} m along"
    return None if stopped.mean_speed_mps is None else _speeding(stopped.mean_speed_mps, segment)


def _counts_implausibility(counts: SegmentCounts, segment: Segment) -> str | None:
    """What is physically impossible in the vehicles that were counted on ``segment``."""
    if counts.watched_s > counts.elapsed_s + 1:
        return f"{counts.watched_s:.4g} s watched in {counts.elapsed_s:.4g} s"
    number = counts.vehicles.value
    if not 0 <= number <= max(segment.lanes, 1) * _MAX_FLOW_HZ * counts.watched_s + 1:
        return f"{number:g} vehicles in {counts.watched_s:.4g} s"
    of_classes = {one.vehicle_class: one.vehicles for one in counts.classes}
    if len(of_classes) != len(counts.classes):
        return "a class twice"
    if any(one.value < 0 for one in of_classes.values()):
        return "a count below 0"
    if abs(sum(one.value for one in of_classes.values()) - number) > 0.5 or counts.speeds > number:
        return f"other classes or more speeds than {number:g} vehicles"
    for estimate in (counts.vehicles, *of_classes.values(), counts.mean_speed_mps, counts.v85_mps):
        if estimate is not None and (estimate.standard_error or 0.0) > MAX_STANDARD_ERROR:
            return f"a standard error of {estimate.standard_error:g}"
    for name in ("mean_speed_mps", "v85_mps"):
        speed: Estimate | None = getattr(counts, name)
        if speed is not None and not 0 <= speed.value <= LIMITS["mean_speed_mps"][1]:
            return f"{name} = {speed.value:g}"
    mean = counts.mean_speed_mps
    return None if mean is None else _speeding(mean.value, segment)


def _speeding(speed: float, segment: Segment) -> str | None:
    limit = segment.speed_limit_mps
    if speed > max(_SPEEDING * limit, limit + _SPEEDING_MPS):
        return f"mean_speed_mps = {speed:g} where {limit:g} is allowed"
    return None
