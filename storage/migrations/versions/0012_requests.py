"""Orders that callers submit, and the vehicles that orders are pinned to."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("orders", sa.Column("request", sa.JSON(), nullable=True))
    op.add_column("orders", sa.Column("received_ns", sa.BigInteger(), nullable=True))
    op.add_column("orders", sa.Column("pinned", sa.String(), nullable=True))
