"""What passages of movements cost, by hour of the day."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "movements",
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("following", sa.String(), nullable=False),
        sa.Column("hour", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("count", sa.Double(), nullable=False),
        sa.Column("loss_kwh", sa.Double(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.Column("stops", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("segment", "following", "hour", name=op.f("pk_movements")),
    )
