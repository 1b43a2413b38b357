"""The tables of the first release."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = None
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
        sa.Column("baseline_driving_s", sa.Double(), nullable=True),
        sa.Column("cooperative_driving_s", sa.Double(), nullable=True),
        sa.Column("price_of_time_kw", sa.Double(), nullable=True),
        sa.Column("unserved", sa.JSON(), nullable=False),
        sa.Column("carriers", sa.JSON(), nullable=False),
        sa.PrimaryKeyConstraint("cycle", name=op.f("pk_cycles")),
    )
    op.create_index(op.f("ix_cycles_started_ns"), "cycles", ["started_ns"], unique=False)
    op.create_table(
        "energy_ledger",
        sa.Column("hour_ns", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("baseline_kwh", sa.Double(), nullable=False),
        sa.Column("plan_kwh", sa.Double(), nullable=False),
        sa.Column("saved_distance_kwh", sa.Double(), nullable=False),
        sa.Column("saved_drag_kwh", sa.Double(), nullable=False),
        sa.Column("saved_acceleration_kwh", sa.Double(), nullable=False),
        sa.Column("distance_m", sa.Double(), nullable=False),
        sa.Column("platooned_m", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("hour_ns", "vehicle", name=op.f("pk_energy_ledger")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "events",
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("time_ns", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("severity", sa.String(), nullable=False),
        sa.Column("subject", sa.String(), nullable=False),
        sa.Column("text", sa.String(), nullable=False),
        sa.Column("mend", sa.String(), nullable=True),
        sa.Column("actor", sa.String(), nullable=True),
        sa.Column("alarm", sa.String(), nullable=True),
        sa.Column("ended_ns", sa.BigInteger(), nullable=True),
        sa.Column("acknowledged_by", sa.String(), nullable=True),
        sa.Column("acknowledged_ns", sa.BigInteger(), nullable=True),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_events")),
    )
    op.create_index(op.f("ix_events_alarm"), "events", ["alarm"], unique=False)
    op.create_index(op.f("ix_events_time_ns"), "events", ["time_ns"], unique=False)
    op.create_table(
        "gate_changes",
        sa.Column("segment_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("watched", sa.Boolean(), nullable=False),
        sa.Column("open", sa.Boolean(), nullable=False),
        sa.Column("y_e", sa.SmallInteger(), nullable=True),
        sa.Column("reason", sa.String(), nullable=True),
        sa.PrimaryKeyConstraint("segment_id", "cycle", name=op.f("pk_gate_changes")),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "input_parts",
        sa.Column("hash", sa.String(), nullable=False),
        sa.Column("data", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("hash", name=op.f("pk_input_parts")),
    )
    op.create_table(
        "movements",
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("following", sa.String(), nullable=False),
        sa.Column("hour", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("count", sa.Double(), nullable=False),
        sa.Column("loss_kwh", sa.Double(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.Column("stops", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("segment", "following", "hour", name=op.f("pk_movements")),
    )
    op.create_table(
        "orders",
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
        sa.Column("request", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("received_ns", sa.BigInteger(), nullable=True),
        sa.Column("pinned", sa.String(), nullable=True),
        sa.PrimaryKeyConstraint("order", name=op.f("pk_orders")),
    )
    op.create_index(op.f("ix_orders_state"), "orders", ["state"], unique=False)
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
    op.create_index(
        op.f("ix_quantum_jobs_submitted_ns"), "quantum_jobs", ["submitted_ns"], unique=False
    )
    op.create_table(
        "segment_rollups",
        sa.Column("period_s", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("began_ns", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("segment_id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("count", sa.BigInteger(), nullable=False),
        sa.Column("stable", sa.BigInteger(), nullable=False),
        sa.Column("turbulent", sa.BigInteger(), nullable=False),
        sa.Column("measured", sa.BigInteger(), nullable=False),
        sa.Column("gaps", sa.BigInteger(), nullable=False),
        sa.Column("vehicles_mean", sa.REAL(), nullable=False),
        sa.Column("vehicles_max", sa.BigInteger(), nullable=False),
        sa.Column("mean_speed_mps_mean", sa.REAL(), nullable=True),
        sa.Column("mean_speed_mps_min", sa.REAL(), nullable=True),
        sa.Column("mean_speed_mps_max", sa.REAL(), nullable=True),
        sa.Column("mean_acceleration_mps2_mean", sa.REAL(), nullable=True),
        sa.Column("mean_acceleration_mps2_min", sa.REAL(), nullable=True),
        sa.Column("mean_acceleration_mps2_max", sa.REAL(), nullable=True),
        sa.Column("density_veh_per_m_mean", sa.REAL(), nullable=True),
        sa.Column("density_veh_per_m_min", sa.REAL(), nullable=True),
        sa.Column("density_veh_per_m_max", sa.REAL(), nullable=True),
        sa.Column("speed_std_mps_mean", sa.REAL(), nullable=True),
        sa.Column("speed_std_mps_min", sa.REAL(), nullable=True),
        sa.Column("speed_std_mps_max", sa.REAL(), nullable=True),
        sa.Column("acceleration_variance_m2ps4_mean", sa.REAL(), nullable=True),
        sa.Column("acceleration_variance_m2ps4_min", sa.REAL(), nullable=True),
        sa.Column("acceleration_variance_m2ps4_max", sa.REAL(), nullable=True),
        sa.Column("mean_gap_m_mean", sa.REAL(), nullable=True),
        sa.Column("mean_gap_m_min", sa.REAL(), nullable=True),
        sa.Column("mean_gap_m_max", sa.REAL(), nullable=True),
        sa.PrimaryKeyConstraint(
            "period_s", "began_ns", "segment_id", name=op.f("pk_segment_rollups")
        ),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "segments",
        sa.Column("id", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("segment", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_segments")),
        sa.UniqueConstraint("segment", name=op.f("uq_segments_segment")),
    )
    op.create_table(
        "speeds",
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("hour", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("count", sa.Double(), nullable=False),
        sa.Column("speed_mps", sa.Double(), nullable=False),
        sa.Column("states", sa.Double(), nullable=False),
        sa.Column("calm", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("segment", "hour", name=op.f("pk_speeds")),
    )
    op.create_table(
        "vehicles",
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("definition", sa.JSON(), nullable=False),
        sa.Column("depot", sa.JSON(), nullable=False),
        sa.Column("position", sa.JSON(none_as_null=True), nullable=True),
        sa.Column("reports_progress", sa.Boolean(), nullable=False),
        sa.Column("answered_ns", sa.BigInteger(), nullable=True),
        sa.Column("left_out_until", sa.BigInteger(), nullable=False),
        sa.Column("booked", sa.Double(), nullable=False),
        sa.Column("rested_ns", sa.BigInteger(), nullable=False),
        sa.Column("rested_break", sa.BigInteger(), nullable=True),
        sa.Column("answer", sa.JSON(none_as_null=True), nullable=True),
        sa.PrimaryKeyConstraint("vehicle", name=op.f("pk_vehicles")),
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
        "cycle_traffic",
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("gates", sa.LargeBinary(), nullable=False),
        sa.Column("states", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_cycle_traffic_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", name=op.f("pk_cycle_traffic")),
    )
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
    op.create_index(op.f("ix_order_changes_time_ns"), "order_changes", ["time_ns"], unique=False)
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
        sa.Column("advice", sa.JSON(), nullable=False),
        sa.Column("continues", sa.BigInteger(), nullable=True),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("status_ns", sa.BigInteger(), nullable=False),
        sa.Column("status_reason", sa.String(), nullable=True),
        sa.Column("segment_energy", sa.JSON(none_as_null=True), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle"], ["cycles.cycle"], name=op.f("fk_plans_cycle_cycles"), ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("cycle", "vehicle", name=op.f("pk_plans")),
    )
    op.create_index(op.f("ix_plans_status"), "plans", ["status"], unique=False)
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
        sa.Column("backend", sa.String(), nullable=True),
        sa.Column("backend_kind", sa.String(), nullable=True),
        sa.Column("fallback", sa.String(), nullable=True),
        sa.Column("two_qubit_depth", sa.BigInteger(), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle"],
            ["cycles.cycle"],
            name=op.f("fk_solver_runs_cycle_cycles"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", "position", name=op.f("pk_solver_runs")),
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
    op.create_index(op.f("ix_input_uses_hash"), "input_uses", ["hash"], unique=False)
    op.create_table(
        "plan_changes",
        sa.Column("cycle", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("time_ns", sa.BigInteger(), nullable=False),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=True),
        sa.ForeignKeyConstraint(
            ["cycle", "vehicle"],
            ["plans.cycle", "plans.vehicle"],
            name=op.f("fk_plan_changes_cycle_plans"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("cycle", "vehicle", "number", name=op.f("pk_plan_changes")),
    )
