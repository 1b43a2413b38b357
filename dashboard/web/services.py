"""What the daemon hands to the routes of the operator's page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Protocol

from fastapi import Depends, Request

from dashboard.live import Snapshot
from dashboard.settings import DashboardSettings
from dashboard.web.energy import EnergyBook
from dashboard.web.hub import PageHub
from dashboard.web.pictures import Pictures
from dashboard.web.tables.rows import Moment, Scene
from dashboard.web.words import Words
from slipstream.http.problems import Problem
from storage import Reader


@dataclass(frozen=True)
class Known:
    """All that is known at one moment.

    Attributes:
        snapshot: the messages.
        moment: the page's tables of them.
        now_ns: UTC.
    """

    snapshot: Snapshot
    moment: Moment
    now_ns: int


class Past(Protocol):
    """Moments that the database keeps."""

    energy: EnergyBook

    def span(self) -> tuple[int, int] | None:
        """First and last moment that is kept, UTC ns; None: nothing is."""
        ...

    def watched(self) -> Mapping[str, Sequence[str]]:
        """Roads by RSU, as far as they are known."""
        ...

    def at(self, time_ns: int) -> Known:
        """What was known then. Raises Problem 404 outside of what is kept."""
        ...


@dataclass(frozen=True)
class PageServices:
    """The page as its routes see it; all of it may be called from any thread.

    Attributes:
        settings: of the dashboard.
        scene: roads and fleet.
        now: what is known now; of a finished run, at its end.
        hub: what happens, for browsers that follow it; None: a finished run is shown.
        pictures: of the cameras; None likewise.
        past: None: there is no database.
        reader: of the database; None: there is none.
    """

    settings: DashboardSettings
    scene: Scene
    now: Callable[[], Known]
    hub: PageHub | None = None
    pictures: Pictures | None = None
    past: Past | None = None
    reader: Reader | None = None

    @cached_property
    def words(self) -> Words:
        """Stored cycles in words."""
        return Words(self.reader)

    def known(self, t: int | None) -> Known:
        """What is known now, or was at a moment.

        Args:
            t: UTC of the moment, ms; None: now.

        Raises:
            Problem: nothing is kept of that moment.
        """
        if t is None:
            return self.now()
        if self.past is None:
            raise Problem(404, "no past is kept", "give database_url in the dashboard's settings")
        return self.past.at(t * 1_000_000)


def _services(request: Request) -> PageServices:
    found: PageServices = request.app.state.services
    return found


Page = Annotated[PageServices, Depends(_services)]
"""A route's parameter of this type is the services."""
