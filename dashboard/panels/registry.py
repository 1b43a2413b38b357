"""The page's panels in their order: a new panel is a line here and a template."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from dashboard.panels.environment import render
from dashboard.view import DashboardView


@dataclass(frozen=True)
class Panel:
    """One block of the page.

    Attributes:
        name: unique.
        title: its heading; None for a block without one.
        template: file in the folder ``templates``, rendered with ``title`` and ``data``.
        data: the part of the view model that the template shows.
    """

    name: str
    title: str | None
    template: str
    data: Callable[[DashboardView], object]

    def html(self, view: DashboardView) -> str:
        """The block's HTML for a view."""
        return render(self.template, title=self.title, data=self.data(view))


HISTORY: Final = Panel("history", None, "history.html.j2", lambda view: view.history)
"""The heading of the energy chart, which follows this panel."""

PANELS: Final = (
    Panel("summary", None, "summary.html.j2", lambda view: view),
    Panel("cycle", "Last dispatch cycle", "cycle.html.j2", lambda view: view.cycle),
    HISTORY,
    Panel("about", "Key to the map", "about.html.j2", lambda view: None),
)
