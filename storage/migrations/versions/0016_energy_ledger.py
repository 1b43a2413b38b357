"""The energy ledger: what was driven by the plans in force, per vehicle and hour.

Plans get what they need on each segment, and vehicles how far theirs is booked, and when their last
break ended. What was driven before is not known.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None

_FIGURES = (
    "baseline_kwh",
    "plan_kwh",
    "saved_distance_kwh",
    "saved_drag_kwh",
    "saved_acceleration_kwh",
    "distance_m",
    "platooned_m",
)


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "energy_ledger",
        sa.Column("hour_ns", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("vehicle", sa.String(), nullable=False),
        *(sa.Column(name, sa.Double(), nullable=False) for name in _FIGURES),
        sa.PrimaryKeyConstraint("hour_ns", "vehicle", name=op.f("pk_energy_ledger")),
        sqlite_with_rowid=False,
    )
    op.add_column("plans", sa.Column("segment_energy", sa.JSON(), nullable=True))
    op.add_column(
        "vehicles", sa.Column("rested_ns", sa.BigInteger(), nullable=False, server_default="0")
    )
    op.add_column("vehicles", sa.Column("booked", sa.Double(), nullable=False, server_default="0"))
