"""Cycles keep the stops that none of their plans visits; those stored before left none out."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    # Never in batch mode, which copies the table and drops the old one: with foreign keys on, that
    # would take the plans, gates, solver runs and states of every cycle with it.
    op.add_column("cycles", sa.Column("unserved", sa.JSON(), server_default="[]", nullable=False))
