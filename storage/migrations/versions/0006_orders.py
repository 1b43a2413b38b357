"""Orders with their history, vehicles, and the status of plans; plans stored before are over."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("plans", sa.Column("continues", sa.BigInteger(), nullable=True))
    op.add_column("plans", sa.Column("status", sa.String(), server_default="done", nullable=False))
    op.add_column(
        "plans", sa.Column("status_ns", sa.BigInteger(), server_default="0", nullable=False)
    )
    op.add_column("plans", sa.Column("status_reason", sa.String(), nullable=True))
    op.create_index(op.f("ix_plans_status"), "plans", ["status"])
    op.create_table(
        "orders",
        # "order" is a word of SQL; the name is quoted.
        sa.Column("order", sa.String(), nullable=False),
        sa.Column("node", sa.String(), nullable=False),
        sa.Column("service_s", sa.Double(), nullable=False),
        sa.Column("demand", sa.BigInteger(), nullable=False),
        sa.Column("earliest_ns", sa.BigInteger(), nullable=True),
        sa.Column("latest_ns", sa.BigInteger(), nullable=True),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("since_ns", sa.BigInteger(), nullable=False),
        sa.Column("reason", sa.String(), nullable=False),
        sa.Column("vehicle", sa.String(), nullable=True),
        sa.Column("cycle", sa.BigInteger(), nullable=True),
        sa.Column("listed", sa.Boolean(), nullable=False),
        sa.PrimaryKeyConstraint("order", name=op.f("pk_orders")),
    )
    op.create_index(op.f("ix_orders_state"), "orders", ["state"])
    op.create_table(
        "order_changes",
        sa.Column("order", sa.String(), nullable=False),
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("time_ns", sa.BigInteger(), nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=False),
        sa.Column("vehicle", sa.String(), nullable=True),
        sa.Column("cycle", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["order"],
            ["orders.order"],
            name=op.f("fk_order_changes_order_orders"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("order", "number", name=op.f("pk_order_changes")),
    )
    op.create_table(
        "vehicles",
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("definition", sa.JSON(), nullable=False),
        sa.Column("depot", sa.JSON(), nullable=False),
        sa.Column("position", sa.JSON(), nullable=True),
        sa.Column("reports_progress", sa.Boolean(), nullable=False),
        sa.Column("answered_ns", sa.BigInteger(), nullable=True),
        sa.Column("left_out_until", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("vehicle", name=op.f("pk_vehicles")),
    )
