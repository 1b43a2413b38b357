"""What road authorities read: DATEX II publications and a WZDx DeviceFeed of the segments' states.

All but `publisher` is pure: states, roads and a time in, a document out.
"""

from dispatcher_daemon.service.feeds.datex2 import EXTENSION_SCHEMA, measured_data, site_table
from dispatcher_daemon.service.feeds.measurements import Measurement, measurements
from dispatcher_daemon.service.feeds.sites import Site, find_sites, watched_pairs
from dispatcher_daemon.service.feeds.wzdx import device_feed

__all__ = [
    "EXTENSION_SCHEMA",
    "Measurement",
    "Site",
    "device_feed",
    "find_sites",
    "measured_data",
    "measurements",
    "site_table",
    "watched_pairs",
]
