"""Camera faults: one judge each, in one ordered list (`judges`), debounced by `Watch`."""

from edge_daemon.watch.reference import read_reference
from edge_daemon.watch.watch import STALE_AFTER_S, Watch

__all__ = ["STALE_AFTER_S", "Watch", "read_reference"]
