"""Changes of plans' statuses, and the latest answer of each vehicle."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "plan_changes",
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("time_ns", sa.BigInteger(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle", "vehicle"],
            ["plans.cycle", "plans.vehicle"],
            name=op.f("fk_plan_changes_cycle_plans"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", "vehicle", "number", name=op.f("pk_plan_changes")),
    )
    op.add_column("vehicles", sa.Column("answer", sa.JSON(), nullable=True))
