"""How long the plans of a cycle drive, and the price that its objective puts on time."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    for name in ("baseline_driving_s", "cooperative_driving_s", "price_of_time_kw"):
        op.add_column("cycles", sa.Column(name, sa.Double(), nullable=True))
