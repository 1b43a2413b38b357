"""Plans keep their driving advice; those stored before gave none."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("plans", sa.Column("advice", sa.JSON(), server_default="{}", nullable=False))
