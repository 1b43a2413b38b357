"""What the server that workers are forked from loads, so that none of them has to.

Only that server imports this module.
"""

from __future__ import annotations

import gc
from importlib import import_module
from typing import Final

MODULES: Final = (
    "dispatcher_daemon.forms",
    "dispatcher_daemon.solvers.registry",
    "dispatcher_daemon.planning.routes",
    "dimod",
)

gc.disable()
for _module in MODULES:
    import_module(_module)
# What is loaded stays: workers share its pages, and no collection looks through it.
gc.freeze()
gc.enable()
