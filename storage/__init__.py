"""The database of dispatch cycles: each cycle is one transaction and durable once recorded.

Only the dispatcher writes (`open_database`); the dashboard and the tools read (`open_reader`). To
store a new field of a message, add a column to `storage.models` and a migration.
"""

from slipstream.energy.ledger import EnergyHour, EnergySum
from storage.database import Database, open_database
from storage.engine import OrderKnownError, StorageError
from storage.integrity import CheckReport, check
from storage.opening import DamagedError
from storage.ownership import OwnedError, check_free
from storage.reader import Reader, StoredCycle, open_reader
from storage.records.events import Event
from storage.records.inputs import CycleInputs, Part
from storage.records.jobs import LedgerState, QuantumJob
from storage.records.past import CycleSums, OrderEnd
from storage.recovery.backup import backup, restore
from storage.recovery.damaged import open_or_set_aside
from storage.retention import Room, UntrustedClockError, headroom
from storage.tables import TableColumn, Tables, table_names
from storage.traffic.history import SegmentAt
from storage.traffic.rollups import RollUp, RollUpBuffer, Spread
