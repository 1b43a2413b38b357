"""Changes of orders are found by their time: for the orders of a moment, or of a day."""

from __future__ import annotations

from alembic import op

revision = "0018"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_index(op.f("ix_order_changes_time_ns"), "order_changes", ["time_ns"])
