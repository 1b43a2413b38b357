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
        InputError: no such key is listened to, or the payload is not what it promises.
    """
    chunks = key.removeprefix(f"{ROOT}/").split("/")
    if chunks[0] == "platoon":
        return decode(PlatoonControl, payload, key)
    if chunks[0] == "rsu":
        return decode(SegmentState, payload, key)
    model = _BY_PLACE.get((chunks[0], chunks[2] if len(chunks) > 2 else ""))
    if model is None:
        raise InputError(key, "not a key that an agent listens to", "check the sender")
    return decode(model, payload, key)
