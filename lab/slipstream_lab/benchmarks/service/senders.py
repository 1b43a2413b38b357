"""Many RSUs or vehicles in one process, their messages spread over the second.

Run as a module: settings as JSON on standard input; writes "declared", then what was sent as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from slipstream.bus import Bus, Publisher
from slipstream.config import BusSettings
from slipstream.messages import (
    Estimate,
    KinematicFeatures,
    Message,
    SegmentState,
    VehiclePosition,
    position_key,
    state_key,
)

_TICK_S = 0.005
_SETTLE_S = 3.0
_DEPOT = 100
_SEQUENCE, _TIME = 8_765_432_109_876_543, 1_234_567_890_123_456_789


@dataclass
class Outlet:
    """A publisher, who it is of, and its message around sequence number and time."""

    publisher: Publisher
    sender: str
    template: bytes

    def put(self, sequence: int, time_ns: int) -> None:
        """Publish the next message."""
        self.publisher.put(self.message(sequence, time_ns))

    def message(self, sequence: int, time_ns: int) -> bytes:
        """The message."""
        return self.template % {b"sequence": sequence, b"time": time_ns}


def a_state(rsu: str, segment: str, sequence: int, time_ns: int) -> SegmentState:
    """A full state of usual length."""
    return SegmentState(
        rsu=rsu,
        segment=segment,
        sequence=sequence,
        time_ns=time_ns,
        window_s=10.0,
        features=KinematicFeatures(
            mean_speed_mps=Estimate(value=13.512345678, standard_error=0.123456789),
            mean_acceleration_mps2=Estimate(value=0.012345678, standard_error=0.012345678),
            density_veh_per_m=Estimate(value=0.0212345678, standard_error=0.0012345678),
            speed_std_mps=Estimate(value=0.412345678, standard_error=0.0812345678),
            acceleration_variance_m2ps4=Estimate(value=0.0512345678, standard_error=0.0112345678),
            mean_gap_m=Estimate(value=22.123456789, standard_error=3.123456789),
        ),
        y_e=1,
        reason=None,
        vehicles=8,
        frames=300,
        coverage=1.0,
    )


def a_position(vehicle: str, segment: str, time_ns: int) -> VehiclePosition:
    """A position of usual length: the vehicle is free and stands at its depot."""
    return VehiclePosition(
        vehicle=vehicle,
        time_ns=time_ns,
        segment=segment,
        share=0.123456789,
        speed_mps=0.0,
        on_road=False,
        cycle=None,
        leg=None,
    )


def _outlet(bus: Bus, sender: str, key: str, message: Message) -> Outlet:
    text = message.to_bytes()
    assert b"%" not in text
    template = text.replace(b"%d" % _SEQUENCE, b"%(sequence)d").replace(b"%d" % _TIME, b"%(time)d")
    return Outlet(bus.publisher(key, history=0), sender, template)


def _outlets(stack: ExitStack, settings: BusSettings, told: dict[str, Any]) -> list[Outlet]:
    """RSUs with a session each and vehicles with one a depot of `_DEPOT`, taking turns, so that
    each one's messages are spread over the second.
    """
    rows: list[list[Outlet]] = []
    for rsu, segments in told.get("watched", {}).items():
        bus = stack.enter_context(Bus.open(settings))
        rows.append(
            [
                _outlet(bus, rsu, state_key(rsu, one), a_state(rsu, one, _SEQUENCE, _TIME))
                for one in segments
            ]
        )
    vehicles = told.get("vehicles", [])
    for begin in range(0, len(vehicles), _DEPOT):
        bus = stack.enter_context(Bus.open(settings))
        rows.append(
            [
                _outlet(bus, one, position_key(one), a_position(one, told["segment"], _TIME))
                for one in vehicles[begin : begin + _DEPOT]
            ]
        )
    return [outlet for turn in zip(*rows, strict=True) for outlet in turn]


def main() -> None:
    """Publish each state or position once a second until told to stop by a line, or its end."""
    told = json.loads(sys.stdin.readline())
    settings = BusSettings(connect=(told["endpoint"],))
    with ExitStack() as stack:
        outlets = _outlets(stack, settings, told)
        deadline = time.monotonic() + 60
        while not all(outlet.publisher.has_subscribers() for outlet in outlets):
            if time.monotonic() > deadline:
                raise SystemExit("no dispatcher listens")
            time.sleep(0.1)
        # Subscribers are known before the routers' ways to them are: the first would be lost.
        time.sleep(_SETTLE_S)
        print("declared", flush=True)
        sequences = dict.fromkeys((outlet.sender for outlet in outlets), 0)
        seconds, began, sent = told["seconds"], time.monotonic(), 0
        late_s = 0.0
        while (now := time.monotonic()) < began + seconds:
            due = int((now - began) * len(outlets))
            late_s = max(late_s, (due - sent) / len(outlets))
            for number in range(sent, due):
                outlet = outlets[number % len(outlets)]
                sequences[outlet.sender] += 1
                outlet.put(sequences[outlet.sender], time.time_ns())
            sent = due
            time.sleep(_TICK_S)
        elapsed_s = time.monotonic() - began
        length = sum(len(outlet.message(_SEQUENCE, _TIME)) for outlet in outlets) / len(outlets)
        done = {"sent": sent, "seconds": elapsed_s, "late_s": late_s, "bytes": length}
        print(json.dumps(done), flush=True)
        sys.stdin.readline()


if __name__ == "__main__":
    main()
