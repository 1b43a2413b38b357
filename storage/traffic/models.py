"""The tables of traffic: segments by number, gates as changes, recent cycles as they were judged,
roll-ups of states, and counted vehicles. Times are UTC nanoseconds.
"""

from __future__ import annotations

from typing import Final, get_args

from sqlalchemy import (
    REAL,
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    LargeBinary,
    SmallInteger,
    String,
    Table,
)

from slipstream.messages import CountedClass, KinematicFeatures
from storage.models import Base

FEATURES: Final = KinematicFeatures.__struct_fields__
SPREAD: Final = ("mean", "min", "max")
"""What is kept of each feature: columns `{feature}_{name}`."""

COUNTED_CLASSES: Final[tuple[CountedClass, ...]] = get_args(CountedClass)
"""Vehicles of each are counted: columns `{class}` and `{class}_error`."""

segments: Final = Table(
    "segments",
    Base.metadata,
    Column("id", BigInteger, primary_key=True, autoincrement=False),
    Column("segment", String, unique=True, nullable=False),
)
"""Numbers of segments, given once and kept."""

# Without a hidden row number: rows lie in the order of their key, and the key is stored once.
gate_changes: Final = Table(
    "gate_changes",
    Base.metadata,
    Column("segment_id", BigInteger, primary_key=True, autoincrement=False),
    Column("cycle", BigInteger, primary_key=True, autoincrement=False),
    Column("watched", Boolean, nullable=False),
    Column("open", Boolean, nullable=False),
    Column("y_e", SmallInteger),
    Column("reason", String),
    sqlite_with_rowid=False,
)
"""A segment's gate from a cycle on, until its next row; not watched: no RSU reported on it."""

cycle_traffic: Final = Table(
    "cycle_traffic",
    Base.metadata,
    Column(
        "cycle",
        BigInteger,
        ForeignKey("cycles.cycle", ondelete="CASCADE"),
        primary_key=True,
        autoincrement=False,
    ),
    Column("gates", LargeBinary, nullable=False),
    Column("states", LargeBinary, nullable=False),
)
"""Gates and states of a recent cycle as messages: JSON, compressed by zlib."""

# Ordered by time first: what is added comes last, and what is too old lies together.
segment_rollups: Final = Table(
    "segment_rollups",
    Base.metadata,
    Column("period_s", BigInteger, primary_key=True, autoincrement=False),
    Column("began_ns", BigInteger, primary_key=True, autoincrement=False),
    Column("segment_id", BigInteger, primary_key=True, autoincrement=False),
    Column("count", BigInteger, nullable=False),
    Column("stable", BigInteger, nullable=False),
    Column("turbulent", BigInteger, nullable=False),
    Column("measured", BigInteger, nullable=False),
    Column("gaps", BigInteger, nullable=False),
    Column("vehicles_mean", REAL, nullable=False),
    Column("vehicles_max", BigInteger, nullable=False),
    *(Column(f"{feature}_{name}", REAL) for feature in FEATURES for name in SPREAD),
    sqlite_with_rowid=False,
)
"""States of a segment in one minute or hour (a `storage.traffic.rollups.RollUp`)."""

# With the names of segments: its rows are few, and people read them as CSV.
segment_counts: Final = Table(
    "segment_counts",
    Base.metadata,
    Column("began_ns", BigInteger, primary_key=True, autoincrement=False),
    Column("segment", String, primary_key=True),
    Column("rsu", String, primary_key=True),
    Column("watched_s", Double, nullable=False),
    Column("reason", String),
    Column("vehicles", Double, nullable=False),
    Column("vehicles_error", Double),
    Column("flow_vph", Double),
    Column("flow_vph_error", Double),
    *(Column(f"{name}{end}", Double) for name in COUNTED_CLASSES for end in ("", "_error")),
    Column("mean_speed_mps", Double),
    Column("mean_speed_mps_error", Double),
    Column("v85_mps", Double),
    Column("v85_mps_error", Double),
    Column("speeds", BigInteger, nullable=False),
    sqlite_with_rowid=False,
)
"""Vehicles that passed on a segment in a quarter hour (a complete `SegmentCounts`)."""
