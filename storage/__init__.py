"""What a pilot keeps: every dispatch cycle, in one transaction, durable once recorded.

Only the dispatcher writes (`open_database`); the dashboard and the tools read (`open_reader`).
"""

from storage.check import CheckReport, check
from storage.database import Database, open_database
from storage.engine import StorageError
from storage.jobs import LedgerState, QuantumJob
from storage.reader import Reader, open_reader

__all__ = [
    "CheckReport",
    "Database",
    "LedgerState",
    "QuantumJob",
    "Reader",
    "StorageError",
    "check",
    "open_database",
    "open_reader",
]
