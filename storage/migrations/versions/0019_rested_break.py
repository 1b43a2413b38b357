"""Vehicles know which break they had last: of two whose windows overlap the other is still due."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("vehicles", sa.Column("rested_break", sa.BigInteger(), nullable=True))
