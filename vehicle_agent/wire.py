"""Which message a key promises, of the keys that an agent listens to."""

from __future__ import annotations

from typing import Final

from slipstream.errors import InputError
from slipstream.messages import (
    ROOT,
    DriverReport,
    Message,
    PlatoonControl,
    PlatoonManagement,
    SegmentState,
    SignalPhaseAndTiming,
    SignalStatus,
    VehiclePlan,
    VehicleSensing,
    decode,
    driver_key,
    plan_key,
    platoon_control_key,
    platoon_management_key,
    sensing_key,
    signal_status_key,
    spat_key,
    state_key,
)

_BY_PLACE: Final[dict[tuple[str, str], type[Message]]] = {
    ("fleet", "plan"): VehiclePlan,
    ("fleet", "platooning"): PlatoonManagement,
    ("vehicle", "sensing"): VehicleSensing,
    ("vehicle", "driver"): DriverReport,
    ("signal", "spat"): SignalPhaseAndTiming,
    ("signal", "status"): SignalStatus,
}
"""By the first chunk of a key behind its root and the third."""


def message_of(key: str, payload: bytes) -> Message:
    """Read the message that came on a key.

    Raises:
        InputError: no such key is listened to, or the payload is not what it promises: routers
            decide by the key who may send what, so the message has to be of its sender.
    """
    message = _decoded(key, payload)
    if _key_of(message) != key:
        raise InputError(key, "not the sender or the place of its key", "check the sender")
    return message


def _decoded(key: str, payload: bytes) -> Message:
    chunks = key.removeprefix(f"{ROOT}/").split("/")
    if chunks[0] == "platoon":
        return decode(PlatoonControl, payload, key)
    if chunks[0] == "rsu":
        return decode(SegmentState, payload, key)
    model = _BY_PLACE.get((chunks[0], chunks[2] if len(chunks) > 2 else ""))
    if model is None:
        raise InputError(key, "not a key that an agent listens to", "check the sender")
    return decode(model, payload, key)


def _key_of(message: Message) -> str | None:
    match message:
        case PlatoonControl():
            return platoon_control_key(message.path[0], message.vehicle)
        case PlatoonManagement():
            return platoon_management_key(message.partner, message.vehicle)
        case SegmentState():
            return state_key(message.rsu, message.segment)
        case SignalPhaseAndTiming():
            return spat_key(message.intersection)
        case SignalStatus():
            return signal_status_key(message.intersection)
        case VehicleSensing():
            return sensing_key(message.vehicle)
        case DriverReport():
            return driver_key(message.vehicle)
        case VehiclePlan():
            return plan_key(message.vehicle)
    return None
