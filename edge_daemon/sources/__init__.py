"""Where pictures come from: recorded clips and camera URLs, one `FrameSource` protocol."""

from edge_daemon.sources.protocol import FrameSource, SourceCounters, SourceSettings, open_source

__all__ = ["FrameSource", "SourceCounters", "SourceSettings", "open_source"]
