"""What the page shows at one moment: a pure function of the latest messages and the time.

`build_view` gives a `DashboardView`, plain data that `dashboard.panels` and `dashboard.scene` draw.
"""

from dashboard.view.build import build_view
from dashboard.view.model import (
    CycleView,
    DashboardView,
    EnergyView,
    HistoryView,
    PreviewView,
    RoadView,
    RsuView,
    VehicleView,
)

__all__ = [
    "CycleView",
    "DashboardView",
    "EnergyView",
    "HistoryView",
    "PreviewView",
    "RoadView",
    "RsuView",
    "VehicleView",
    "build_view",
]
