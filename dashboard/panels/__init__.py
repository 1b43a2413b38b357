"""The panels around the map: one registry, one template a panel, docked on viser's page.

To add a panel: a field of `dashboard.view.DashboardView`, what fills it in `build_view`, a line in
`registry.PANELS` and a template.
"""

from dashboard.panels.layout import PanelLayout
from dashboard.panels.registry import PANELS, Panel

__all__ = ["PANELS", "Panel", "PanelLayout"]
