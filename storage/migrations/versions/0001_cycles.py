"""Cycles with their solver runs, gates, plans and segment states."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Apply."""
    op.create_table(
        "cycles",
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("started_ns", sa.BigInteger(), nullable=False),
        sa.Column("wall_s", sa.Double(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.Column("solver", sa.String(), nullable=True),
        sa.Column("objective_kwh", sa.Double(), nullable=True),
        sa.Column("variables", sa.BigInteger(), nullable=False),
        sa.Column("plan_count", sa.BigInteger(), nullable=False),
        sa.Column("baseline", sa.String(), nullable=True),
        sa.Column("baseline_kwh", sa.Double(), nullable=True),
        sa.Column("cooperative_kwh", sa.Double(), nullable=True),
        sa.Column("saved_distance_kwh", sa.Double(), nullable=True),
        sa.Column("saved_drag_kwh", sa.Double(), nullable=True),
        sa.Column("saved_acceleration_kwh", sa.Double(), nullable=True),
        sa.Column("platooned_distance_m", sa.Double(), nullable=True),
        sa.PrimaryKeyConstraint("cycle", name=op.f("pk_cycles")),
    )
    with op.batch_alter_table("cycles", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_cycles_started_ns"), ["started_ns"], unique=False)

    op.create_table(
        "gates",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("position", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("y_e", sa.BigInteger(), nullable=True),
        sa.Column("reason", sa.String(), nullable=True),
        sa.Column("age_s", sa.Double(), nullable=True),
        sa.Column("speed_mps", sa.Double(), nullable=True),
        sa.Column("open", sa.Boolean(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"], ["cycles.cycle"], name=op.f("fk_gates_cycle_cycles"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("cycle", "position", name=op.f("pk_gates")),
    )
    op.create_table(
        "plans",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("issued_ns", sa.BigInteger(), nullable=False),
        sa.Column("valid_until_ns", sa.BigInteger(), nullable=False),
        sa.Column("depart_ns", sa.BigInteger(), nullable=False),
        sa.Column("distance_m", sa.Double(), nullable=False),
        sa.Column("energy_kwh", sa.Double(), nullable=False),
        sa.Column("stops", sa.JSON(), nullable=False),
        sa.Column("segments", sa.JSON(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"], ["cycles.cycle"], name=op.f("fk_plans_cycle_cycles"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("cycle", "vehicle", name=op.f("pk_plans")),
    )
    op.create_table(
        "segment_states",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("rsu", sa.String(), nullable=False),
        sa.Column("sequence", sa.BigInteger(), nullable=False),
        sa.Column("time_ns", sa.BigInteger(), nullable=False),
        sa.Column("window_s", sa.Double(), nullable=False),
        sa.Column("y_e", sa.BigInteger(), nullable=True),
        sa.Column("reason", sa.String(), nullable=True),
        sa.Column("vehicles", sa.BigInteger(), nullable=False),
        sa.Column("frames", sa.BigInteger(), nullable=False),
        sa.Column("coverage", sa.Double(), nullable=False),
        sa.Column("features", sa.JSON(none_as_null=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_segment_states_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", "segment", "rsu", name=op.f("pk_segment_states")),
    )
    op.create_table(
        "solver_runs",
        sa.Column("cycle", sa.BigInteger(), nullable=False),
        sa.Column("position", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("solver", sa.String(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("objective_kwh", sa.Double(), nullable=True),
        sa.Column("repaired", sa.Boolean(), nullable=False),
        sa.Column("p_feasible_raw", sa.Double(), nullable=True),
        sa.Column("p_optimal_raw", sa.Double(), nullable=True),
        sa.Column("p_feasible_repaired", sa.Double(), nullable=True),
        sa.Column("qubits", sa.BigInteger(), nullable=True),
        sa.Column("shots", sa.BigInteger(), nullable=True),
        sa.Column("wall_s", sa.Double(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_solver_runs_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", "position", name=op.f("pk_solver_runs")),
    )
