"""Docks the panel beside the map; its summary is sent again only when its HTML has changed."""

from __future__ import annotations

from typing import Final

import viser

from dashboard.panels.environment import render
from dashboard.view.build import DashboardView

SIDE_WIDTH_PX: Final = 400
"""Leaves more than half of a window of 1,024 px to the map."""
VIEW_ORDER: Final = 2.0
CARD_ORDER: Final = 3.0
"""Places in the panel of the buttons for the view, and of a browser's card."""


class PanelLayout:
    """What of the panel all browsers share."""

    def __init__(self, server: viser.ViserServer) -> None:
        gui = server.gui
        gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=(0, 90, 140),
        )
        gui.set_panel_label("Slipstream in 3D")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(SIDE_WIDTH_PX)
        gui.add_html(render("style.html.j2"), order=0.0)
        # The headline stands above what each browser has for itself.
        self._summary = gui.add_html("", order=1.0)
        gui.add_html(render("about.html.j2"), order=4.0)
        self._sent = ""

    def update(self, view: DashboardView) -> None:
        """Show a view."""
        content = render("summary.html.j2", view=view)
        if content != self._sent:
            self._sent = self._summary.content = content


def frame_html(units_per_m: float) -> str:
    """What the page's head needs beside viser's: colour scheme, layout, north arrow and scale.

    The browser follows its own camera, as the panels can be collapsed, with all that is in them.

    Args:
        units_per_m: units of the scene that 1 m is long.
    """
    return render("frame.html.j2", units_per_m=units_per_m)
