"""Docks the panels beside the map; a block is sent again only when its HTML has changed."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
import viser
import viser.uplot

from dashboard.panels.environment import render
from dashboard.panels.registry import HISTORY, PANELS
from dashboard.view import DashboardView, HistoryView

SIDE_WIDTH_PX: Final = 400
"""Leaves more than half of a window of 1,024 px to the map."""
VIEW_ORDER: Final = 2.0
CARD_ORDER: Final = 3.0
"""Places in the panel of the buttons for the view, and of a browser's card."""
FIRST_BLOCK: Final = 4
_BASELINE = "#8a929d"
_COOPERATIVE = "#2f7fd1"


class PanelLayout:
    """All panels on a viser server, and the energy chart.

    Args:
        server: the viser server to build them on.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        gui = self._gui = server.gui
        gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=(0, 90, 140),
        )
        gui.set_panel_label("Slipstream in 3D")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(SIDE_WIDTH_PX)
        self._blocks: dict[str, viser.GuiHtmlHandle] = {}
        self._sent: dict[str, str] = {}
        self._history = HistoryView()
        gui.add_html(render("style.html.j2"), order=0.0)
        for place, panel in enumerate(PANELS, start=FIRST_BLOCK):
            # The headline stands above what each browser has for itself.
            order = 1.0 if panel.name == "summary" else float(place)
            self._blocks[panel.name] = gui.add_html("", order=order)
            if panel is HISTORY:
                self._chart = self._add_chart(place + 0.5)

    def update(self, view: DashboardView) -> None:
        """Show a view."""
        for panel in PANELS:
            content = panel.html(view)
            if self._sent.get(panel.name) != content:
                self._sent[panel.name] = content
                self._blocks[panel.name].content = content
        if view.history != self._history:
            self._history = view.history
            self._chart.data = _chart_data(view.history)
            self._chart.visible = len(view.history.cycles) > 1

    def _add_chart(self, order: float) -> viser.GuiUplotHandle:
        return self._gui.add_uplot(
            data=_chart_data(self._history),
            series=(
                viser.uplot.Series(label="cycle"),
                viser.uplot.Series(label="alone", stroke=_BASELINE, width=2, dash=(6, 4)),
                viser.uplot.Series(label="cooperative", stroke=_COOPERATIVE, width=2),
            ),
            scales={"x": viser.uplot.Scale(time=False)},
            axes=(
                viser.uplot.Axis(size=26, incrs=(1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)),
                viser.uplot.Axis(size=46),
            ),
            legend=viser.uplot.Legend(show=False),
            height=140,
            visible=False,
            order=order,
        )


def frame_html(units_per_m: float) -> str:
    """What the page's head needs beside viser's: colour scheme, layout, north arrow and scale.

    The browser follows its own camera, as the panels can be collapsed, with all that is in them.

    Args:
        units_per_m: units of the scene that 1 m is long.
    """
    return render("frame.html.j2", units_per_m=units_per_m)


def _chart_data(history: HistoryView) -> tuple[npt.NDArray[np.float64], ...]:
    # The chart wants at least one point.
    return tuple(
        np.array(values or (0.0,), dtype=np.float64)
        for values in (history.cycles, history.baseline_kwh, history.cooperative_kwh)
    )
