"""The ledger of quantum jobs; solver runs tell where a circuit ran and why not elsewhere."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.add_column("solver_runs", sa.Column("backend", sa.String(), nullable=True))
    op.add_column("solver_runs", sa.Column("backend_kind", sa.String(), nullable=True))
    op.add_column("solver_runs", sa.Column("fallback", sa.String(), nullable=True))
    op.add_column("solver_runs", sa.Column("two_qubit_depth", sa.BigInteger(), nullable=True))
    op.create_table(
        "quantum_jobs",
        sa.Column("tag", sa.String(), nullable=False),
        sa.Column("job_id", sa.String(), nullable=True),
        sa.Column("backend", sa.String(), nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("submitted_ns", sa.BigInteger(), nullable=False),
        sa.Column("updated_ns", sa.BigInteger(), nullable=False),
        sa.Column("finished_ns", sa.BigInteger(), nullable=True),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.Column("estimate_s", sa.Double(), nullable=False),
        sa.Column("usage_s", sa.Double(), nullable=True),
        sa.Column("shots", sa.BigInteger(), nullable=False),
        sa.Column("circuit", sa.String(), nullable=False),
        sa.Column("variables", sa.String(), nullable=False),
        sa.Column("chain_order", sa.JSON(), nullable=False),
        sa.Column("variant", sa.String(), nullable=False),
        sa.Column("layers", sa.BigInteger(), nullable=False),
        sa.Column("two_qubit_depth", sa.BigInteger(), nullable=True),
        sa.Column("two_qubit_gates", sa.BigInteger(), nullable=True),
        sa.Column("train_s", sa.Double(), nullable=False),
        sa.Column("answer", sa.String(), nullable=True),
        sa.Column("answer_cycle", sa.BigInteger(), nullable=True),
        sa.PrimaryKeyConstraint("tag", name=op.f("pk_quantum_jobs")),
    )
    # No foreign key to cycles: a job is stored before its cycle is, and may outlive it.
    op.create_index(op.f("ix_quantum_jobs_submitted_ns"), "quantum_jobs", ["submitted_ns"])
