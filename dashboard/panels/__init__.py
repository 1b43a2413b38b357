"""The panels beside the map: one registry, one template a panel; and the card of a selection.

To add a panel: a field of `dashboard.view.DashboardView`, what fills it in `build_view`, a line in
`registry.PANELS` and a template.
"""

from dashboard.panels.card import card_html
from dashboard.panels.layout import PanelLayout, frame_html
from dashboard.panels.registry import PANELS, Panel

__all__ = ["PANELS", "Panel", "PanelLayout", "card_html", "frame_html"]
