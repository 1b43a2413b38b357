"""What cycles were made from; parts that many cycles have are stored once."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "input_parts",
        sa.Column("hash", sa.String(), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("hash", name=op.f("pk_input_parts")),
    )
    op.create_table(
        "cycle_inputs",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_cycle_inputs_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", name=op.f("pk_cycle_inputs")),
    )
    op.create_table(
        "input_uses",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("hash", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycle_inputs.cycle"],
            name=op.f("fk_input_uses_cycle_cycle_inputs"),
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["hash"], ["input_parts.hash"], name=op.f("fk_input_uses_hash_input_parts")
        ),
        sa.PrimaryKeyConstraint("cycle", "name", name=op.f("pk_input_uses")),
    )
    op.create_index(op.f("ix_input_uses_hash"), "input_uses", ["hash"])
