"""Where frames come from: recorded clips and camera URLs, one `FrameSource` protocol."""

from edge_daemon.sources.masks import hidden
from edge_daemon.sources.protocol import FrameSource, SourceCounters
from edge_daemon.sources.registry import open_source
from edge_daemon.sources.repeats import mark_repeats

__all__ = ["FrameSource", "SourceCounters", "hidden", "mark_repeats", "open_source"]
