"""Faults of a camera: frozen, dark, bright, obscured, corrupt, moved, stale, its clock."""

from edge_daemon.settings import WatchSettings
from edge_daemon.watch.reference import read_reference
from edge_daemon.watch.watch import Watch

__all__ = ["Watch", "WatchSettings", "read_reference"]
