"""The time up to which the dispatcher's clock was to be trusted: at first the newest cycle's."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "clock",
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("trusted_ns", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_clock")),
    )
    op.execute(
        "INSERT INTO clock (id, trusted_ns) "
        "SELECT 1, max(started_ns) FROM cycles HAVING count(*) > 0"
    )
