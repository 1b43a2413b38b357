"""Docks the panels around the map; a block is sent again only when its HTML has changed."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
import viser
import viser.uplot

from dashboard.panels.environment import render
from dashboard.panels.registry import HISTORY, PANELS, Panel
from dashboard.view import DashboardView, HistoryView

SIDE_WIDTH_PX: Final = 540
_BASELINE = "#8a929d"
_COOPERATIVE = "#005ab5"


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
        gui.set_panel_label("Dispatch and health")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(SIDE_WIDTH_PX)
        self._style = render("style.html.j2")
        self._blocks: dict[str, viser.GuiHtmlHandle] = {}
        self._sent: dict[str, str] = {}
        self._history = HistoryView()
        gui.add_html(self._style)
        for panel in PANELS:
            if panel.dock == "side":
                self._blocks[panel.name] = gui.add_html("")
            if panel is HISTORY:
                self._chart = self._add_chart()
        for panel in PANELS:
            if panel.dock != "side":
                self._add_window(panel)

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

    def _add_window(self, panel: Panel) -> None:
        window = self._gui.add_panel()
        with window.add_tab(panel.title or ""):
            self._gui.add_html(self._style)
            self._blocks[panel.name] = self._gui.add_html("")
        if panel.dock == "top":
            window.float(x=12, y=12, width=640)
        else:
            window.float(x=12, y=-12, width=660)

    def _add_chart(self) -> viser.GuiUplotHandle:
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
        )


def _chart_data(history: HistoryView) -> tuple[npt.NDArray[np.float64], ...]:
    # The chart wants at least one point.
    return tuple(
        np.array(values or (0.0,), dtype=np.float64)
        for values in (history.cycles, history.baseline_kwh, history.cooperative_kwh)
    )
