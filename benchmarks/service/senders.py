"""Many RSUs in one process: each with a session of its own, its states spread over the second.

Run as a module: settings as JSON on standard input; writes "declared", then what was sent as JSON.
"""

from __future__ import annotations

import json
import sys
import time
from contextlib import ExitStack
from dataclasses import dataclass

from slipstream.bus import Bus, Publisher
from slipstream.config import BusSettings
from slipstream.messages import Estimate, KinematicFeatures, SegmentState, state_key

_TICK_S = 0.005
_SETTLE_S = 3.0
_SEQUENCE, _TIME = 8_765_432_109_876_543, 1_234_567_890_123_456_789


@dataclass
class Outlet:
    """A segment's publisher, and its state's bytes around sequence number and time."""

    publisher: Publisher
    rsu: str
    parts: tuple[bytes, bytes, bytes]

    def put(self, sequence: int, time_ns: int) -> None:
        """Publish the next state."""
        before, between, after = self.parts
        self.publisher.put(b"%b%d%b%d%b" % (before, sequence, between, time_ns, after))


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


def _outlet(bus: Bus, rsu: str, segment: str) -> Outlet:
    text = a_state(rsu, segment, _SEQUENCE, _TIME).to_bytes()
    before, rest = text.split(str(_SEQUENCE).encode())
    between, after = rest.split(str(_TIME).encode())
    publisher = bus.publisher(state_key(rsu, segment), history=0)
    return Outlet(publisher, rsu, (before, between, after))


def main() -> None:
    """Publish each segment's state once a second until told to stop by a line, or its end."""
    told = json.loads(sys.stdin.readline())
    settings = BusSettings(connect=(told["endpoint"],))
    with ExitStack() as stack:
        buses = {rsu: stack.enter_context(Bus.open(settings)) for rsu in told["watched"]}
        # RSUs take turns, so that each one's states are spread over the second.
        rows = [
            [_outlet(buses[rsu], rsu, segment) for segment in segments]
            for rsu, segments in told["watched"].items()
        ]
        outlets = [outlet for turn in zip(*rows, strict=True) for outlet in turn]
        deadline = time.monotonic() + 60
        while not all(outlet.publisher.has_subscribers() for outlet in outlets):
            if time.monotonic() > deadline:
                raise SystemExit("no dispatcher listens")
            time.sleep(0.1)
        # Subscribers are known before the routers' ways to them are: the first would be lost.
        time.sleep(_SETTLE_S)
        print("declared", flush=True)
        sequences = dict.fromkeys(buses, 0)
        seconds, began, sent = told["seconds"], time.monotonic(), 0
        late_s = 0.0
        while (now := time.monotonic()) < began + seconds:
            due = int((now - began) * len(outlets))
            late_s = max(late_s, (due - sent) / len(outlets))
            for number in range(sent, due):
                outlet = outlets[number % len(outlets)]
                sequences[outlet.rsu] += 1
                outlet.put(sequences[outlet.rsu], time.time_ns())
            sent = due
            time.sleep(_TICK_S)
        elapsed_s = time.monotonic() - began
        print(json.dumps({"sent": sent, "seconds": elapsed_s, "late_s": late_s}), flush=True)
        sys.stdin.readline()


if __name__ == "__main__":
    main()
