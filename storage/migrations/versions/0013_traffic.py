"""Gates as changes, roll-ups of states, and recent cycles' gates and states in one row.

What is stored in `gates` and `segment_states` stays there until the dispatcher, or `slipstream db
upgrade`, has converted it in small steps (`storage.traffic.conversion`).
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

_FEATURES = (
    "mean_speed_mps",
    "mean_acceleration_mps2",
    "density_veh_per_m",
    "speed_std_mps",
    "acceleration_variance_m2ps4",
    "mean_gap_m",
)


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "segments",
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("segment", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_segments")),
        sa.UniqueConstraint("segment", name=op.f("uq_segments_segment")),
    )
    op.create_table(
        "gate_changes",
        sa.Column("segment_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("watched", sa.Boolean(), nullable=False),
        sa.Column("open", sa.Boolean(), nullable=False),
        sa.Column("y_e", sa.SmallInteger(), nullable=True),
        sa.Column("reason", sa.String(), nullable=True),
        sa.PrimaryKeyConstraint("segment_id", "cycle", name=op.f("pk_gate_changes")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "cycle_traffic",
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("gates", sa.LargeBinary(), nullable=False),
        sa.Column("states", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_cycle_traffic_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", name=op.f("pk_cycle_traffic")),
    )
    counts = ("count", "stable", "turbulent", "measured", "gaps")
    op.create_table(
        "segment_rollups",
        sa.Column("period_s", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("began_ns", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("segment_id", sa.BigInteger(), autoincrement=False, nullable=False),
        *(sa.Column(name, sa.BigInteger(), nullable=False) for name in counts),
        sa.Column("vehicles_mean", sa.REAL(), nullable=False),
        sa.Column("vehicles_max", sa.BigInteger(), nullable=False),
        *(
            sa.Column(f"{feature}_{name}", sa.REAL(), nullable=True)
            for feature in _FEATURES
            for name in ("mean", "min", "max")
        ),
        sa.PrimaryKeyConstraint(
            "period_s", "began_ns", "segment_id", name=op.f("pk_segment_rollups")
        ),
        sqlite_with_rowid=False,
    )
