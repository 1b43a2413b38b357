"""The signal controllers of the running simulation, as a city's: SPAT out, SRM in, SSM out.

`SignalController` is all that others need. Inside: `program` (phases), `timing` (programs as they
run), `spat` (messages), `open_requests`, `priority_rules` and `priority` (what is done for them),
`detectors`.
"""

from slipstream_lab.simulation.signals.controller import SignalController
from slipstream_lab.simulation.signals.priority_rules import PrioritySettings

__all__ = ["PrioritySettings", "SignalController"]
