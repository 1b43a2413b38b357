"""Cycles keep what each of several carriers has; of those stored before it is not known."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    # Never in batch mode, which copies the table and drops the old one: with foreign keys on, that
    # would take the plans, gates, solver runs and states of every cycle with it.
    op.add_column("cycles", sa.Column("carriers", sa.JSON(), server_default="[]", nullable=False))
