"""The first release, whose tables `storage.schema.upgrade` makes from the models."""

revision = "0021"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Nothing comes before."""
