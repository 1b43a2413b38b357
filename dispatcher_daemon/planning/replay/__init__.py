"""What a cycle was made from, stored with it, and the same cycle made again."""

from __future__ import annotations

from dispatcher_daemon.planning.replay.again import Replayed, replayed
from dispatcher_daemon.planning.replay.inputs import (
    InputEncoder,
    cycle_record,
    restored_cycle,
    restored_settings,
)
from dispatcher_daemon.planning.replay.trace import Trace, TraceRecorder

__all__ = [
    "InputEncoder",
    "Replayed",
    "Trace",
    "TraceRecorder",
    "cycle_record",
    "replayed",
    "restored_cycle",
    "restored_settings",
]
