"""The card of what a browser has selected."""

from __future__ import annotations

from typing import Final

from dashboard.panels.environment import render
from dashboard.selection import Selection
from dashboard.view.build import DashboardView
from dashboard.view.model import PreviewView

_MAX_STOPS: Final = 8
_MISSING: Final = {
    "van": "No plan of it is in force, or no such vehicle is known.",
    "road": "No camera watches it.",
    "rsu": "It has not reported.",
}


def card_html(
    view: DashboardView | None,
    selection: Selection | None,
    operator_url: str | None,
    picture: PreviewView | None = None,
) -> str:
    """The card's HTML.

    Args:
        operator_url: base of the operator's page, for a link to it or to the same there; None: no
            link.
    """
    data: object = None
    if view is not None and selection is not None:
        name = selection.id
        if selection.kind == "van":
            data = next((van for van in view.vehicles if van.vehicle == name), None)
        elif selection.kind == "road":
            data = next((road for road in view.roads if road.segment == name), None)
        else:
            data = next((rsu for rsu in view.rsus if rsu.rsu == name), None)
    link = None
    if operator_url is not None:
        fragment = "" if selection is None else f"#{selection.fragment()}"
        link = f"{operator_url.rstrip('/')}/{fragment}"
    return render(
        "card.html.j2",
        selection=selection,
        data=data,
        picture=picture,
        link=link,
        missing=_MISSING[selection.kind] if selection is not None else "",
        MAX_STOPS=_MAX_STOPS,
    )
