"""Settings of the dispatcher, and of the processes of its cluster."""

from dispatcher_daemon.settings.city import CitySettings, SearchSettings
from dispatcher_daemon.settings.cluster import (
    LOCAL,
    ClusterSettings,
    SchedulerSettings,
    WorkerSettings,
)
from dispatcher_daemon.settings.dispatcher import (
    AdviceSettings,
    ApiSettings,
    DispatcherSettings,
    FeedSettings,
    OrderSettings,
    Scope,
)
from dispatcher_daemon.settings.hardware import HardwareSettings
from dispatcher_daemon.settings.solvers import (
    BUILT_IN_SOLVERS,
    SOLVER_ENTRY_POINTS,
    LcQaoaSettings,
    LcQaoaVariant,
    QaoaSettings,
    solver_names,
)

__all__ = [
    "BUILT_IN_SOLVERS",
    "LOCAL",
    "SOLVER_ENTRY_POINTS",
    "AdviceSettings",
    "ApiSettings",
    "CitySettings",
    "ClusterSettings",
    "DispatcherSettings",
    "FeedSettings",
    "HardwareSettings",
    "LcQaoaSettings",
    "LcQaoaVariant",
    "OrderSettings",
    "QaoaSettings",
    "SchedulerSettings",
    "Scope",
    "SearchSettings",
    "WorkerSettings",
    "solver_names",
]
