"""What the daemon hands to the routes of the operator's page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Final

from fastapi import Depends, Request
from fastapi.responses import Response

from dashboard.settings import DashboardSettings
from dashboard.web.hub import PageHub, encoded
from dashboard.web.network import network_document
from dashboard.web.past.stored import StoredPast
from dashboard.web.pictures import Pictures
from dashboard.web.static_files import StaticFile
from dashboard.web.tables.rows import Known, Scene
from dashboard.web.words import Words
from slipstream.http.problems import Problem
from storage import Reader

_NO_PAST: Final = ("no past is kept", "give database_url in the dashboard's settings")


@dataclass(frozen=True)
class PageServices:
    """The page as its routes see it; all of it may be called from any thread.

    Attributes:
        now: what is known now; of a finished run, at its end.
        hub: what happens, for browsers that follow it; None: a finished run is shown.
    """

    settings: DashboardSettings
    scene: Scene
    now: Callable[[], Known]
    hub: PageHub | None = None
    pictures: Pictures | None = None
    past: StoredPast | None = None
    reader: Reader | None = None

    @cached_property
    def words(self) -> Words:
        """Stored cycles in words."""
        return Words(self.reader)

    def known(self, t: int | None) -> Known:
        """What is known now, or was at a moment.

        Raises:
            Problem: nothing is kept of that moment.
        """
        if t is None:
            return self.now()
        return self.stored_past.at(t * 1_000_000)

    @property
    def stored_past(self) -> StoredPast:
        """The kept past. Raises Problem 404 where there is none."""
        if self.past is None:
            raise Problem(404, *_NO_PAST)
        return self.past

    @property
    def stored(self) -> Reader:
        """The database. Raises Problem 404 where there is none."""
        if self.reader is None:
            raise Problem(404, *_NO_PAST)
        return self.reader

    @cached_property
    def network(self) -> StaticFile:
        """The roads as a browser gets them."""
        document = encoded(network_document(self.scene))
        return StaticFile.of(document, "application/json")


def _services(request: Request) -> PageServices:
    found: PageServices = request.app.state.services
    return found


Page = Annotated[PageServices, Depends(_services)]
"""A route's parameter of this type is the services."""


def as_json(data: Any) -> Response:
    """An answer of compact JSON."""
    return Response(encoded(data), media_type="application/json")
