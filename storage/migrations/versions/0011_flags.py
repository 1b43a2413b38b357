"""Flags that RSUs have given, by hour of the day."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    for name in ("states", "calm"):
        op.add_column("speeds", sa.Column(name, sa.Double(), server_default="0", nullable=False))
