"""Vehicles counted in quarter hours."""

from alembic import op
from sqlalchemy import BigInteger, Column, Double, String

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None

_FIGURES = ("flow_vph", "car", "truck", "bus", "motorcycle", "mean_speed_mps", "v85_mps")


def upgrade() -> None:
    """A table of its own; no other is touched."""
    op.create_table(
        "segment_counts",
        Column("began_ns", BigInteger, primary_key=True, autoincrement=False),
        Column("segment", String, primary_key=True),
        Column("rsu", String, primary_key=True),
        Column("watched_s", Double, nullable=False),
        Column("reason", String),
        Column("vehicles", Double, nullable=False),
        Column("vehicles_error", Double),
        *(Column(f"{name}{end}", Double) for name in _FIGURES for end in ("", "_error")),
        Column("speeds", BigInteger, nullable=False),
        sqlite_with_rowid=False,
    )
