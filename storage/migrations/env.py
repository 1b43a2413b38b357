"""Run by Alembic: migrates on the connection of `storage.schema.upgrade`."""

from alembic import context

from storage.models import Base
from storage.records import energy_ledger as _of_energy  # noqa: F401 (its table joins those of Base)
from storage.traffic import models as _of_traffic  # noqa: F401 (their tables join those of Base)

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    # SQLite can roll back DDL; a killed upgrade must not leave half a schema.
    transactional_ddl=True,
    render_as_batch=True,
)
with context.begin_transaction():
    context.run_migrations()
