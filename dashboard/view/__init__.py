"""What the page shows at one moment: a pure function of the latest messages and the time.

`build_view` gives a `DashboardView`, plain data that `dashboard.panels` and `dashboard.scene` draw.
"""

from dashboard.view import labels
from dashboard.view.build import build_view
from dashboard.view.dispatcher import execution_summary
from dashboard.view.labels import Level, Rgb, Traffic
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
    "Level",
    "PreviewView",
    "Rgb",
    "RoadView",
    "RsuView",
    "Traffic",
    "VehicleView",
    "build_view",
    "execution_summary",
    "labels",
]
