"""The page's panels in their order: a new panel is a line here and a template."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from dashboard.panels.environment import render
from dashboard.view import DashboardView

Dock = Literal["side", "top", "bottom"]


@dataclass(frozen=True)
class Panel:
    """One block of the page.

    Attributes:
        name: unique.
        title: its heading, or the label of its tab where it floats; None for a block without one.
        template: file in the folder ``templates``, rendered with ``title`` and ``data``.
        data: the part of the view model that the template shows.
        dock: the column at the right of the map, or a window above or below the map.
    """

    name: str
    title: str | None
    template: str
    data: Callable[[DashboardView], object]
    dock: Dock = "side"

    def html(self, view: DashboardView) -> str:
        """The block's HTML for a view."""
        return render(self.template, title=self.title, data=self.data(view))


HISTORY: Final = Panel("history", None, "history.html.j2", lambda view: view.history)
"""The heading of the energy chart, which follows this panel."""

PANELS: Final = (
    Panel("about", "Slipstream", "about.html.j2", lambda view: None, "top"),
    Panel("cameras", "Roadside cameras", "cameras.html.j2", lambda view: view.previews, "bottom"),
    Panel("summary", None, "summary.html.j2", lambda view: view),
    Panel("roads", "Watched roads", "roads.html.j2", lambda view: view.roads),
    Panel("vehicles", "Vans", "vehicles.html.j2", lambda view: view.vehicles),
    Panel("rsus", "Roadside units", "rsus.html.j2", lambda view: view.rsus),
    Panel("cycle", "Last dispatch cycle", "cycle.html.j2", lambda view: view.cycle),
    HISTORY,
)
