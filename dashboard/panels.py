"""The panels around the map; each block is sent again only when its HTML has changed."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt
import viser
import viser.uplot

from dashboard import html, markup
from dashboard.views import DashboardView, HistoryView

PANEL_WIDTH_PX: Final = 540
_BASELINE = "#8a929d"
_COOPERATIVE = "#005ab5"


class Panels:
    """Title and key above the map, cameras below it, figures at its right.

    Args:
        server: the viser server to build them on.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        gui = server.gui
        gui.configure_theme(
            control_width="large",
            show_logo=False,
            show_share_button=False,
            brand_color=(0, 90, 140),
        )
        gui.set_panel_label("Dispatch and health")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH_PX)
        gui.add_html(markup.STYLE)
        self._blocks = {
            name: gui.add_html("") for name in ("summary", "roads", "vehicles", "rsus", "cycle")
        }
        self._history_title = gui.add_html("")
        self._history = HistoryView()
        self._chart = gui.add_uplot(
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
        about = gui.add_panel()
        with about.add_tab("Slipstream"):
            gui.add_html(markup.STYLE + html.about())
        about.float(x=12, y=12, width=640)
        cameras = gui.add_panel()
        with cameras.add_tab("Roadside cameras"):
            gui.add_html(markup.STYLE)
            self._blocks["cameras"] = gui.add_html("")
        cameras.float(x=12, y=-12, width=660)
        self._sent: dict[str, str] = {}

    def update(self, view: DashboardView) -> None:
        """Show a view."""
        self._send("summary", html.summary(view))
        self._send("roads", html.roads(view.roads))
        self._send("vehicles", html.vehicles(view.vehicles))
        self._send("cycle", html.cycle(view.cycle))
        self._send("rsus", html.rsus(view.rsus))
        self._send("cameras", html.cameras(view.previews))
        if view.history != self._history:
            self._history = view.history
            self._history_title.content = html.history_title(view.history)
            self._chart.data = _chart_data(view.history)
            self._chart.visible = len(view.history.cycles) > 1

    def _send(self, name: str, content: str) -> None:
        if self._sent.get(name) != content:
            self._sent[name] = content
            self._blocks[name].content = content


def _chart_data(history: HistoryView) -> tuple[npt.NDArray[np.float64], ...]:
    # The chart wants at least one point.
    return tuple(
        np.array(values or (0.0,), dtype=np.float64)
        for values in (history.cycles, history.baseline_kwh, history.cooperative_kwh)
    )
