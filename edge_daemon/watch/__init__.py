"""Camera faults: one judge each, in one ordered list (`judges`), debounced by `Watch`."""

from edge_daemon.watch.reference import read_reference
from edge_daemon.watch.watch import Watch

__all__ = ["Watch", "read_reference"]
