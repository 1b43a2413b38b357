"""The 3D view: one viser server with map and panels, its browsers and its restart."""

from __future__ import annotations

import logging
import threading
from collections.abc import Collection
from contextlib import ExitStack
from typing import Final

import viser

from dashboard import metrics, selection
from dashboard.browser import PLACES, Browser
from dashboard.live import LiveData
from dashboard.panels.layout import VIEW_ORDER, PanelLayout, frame_html
from dashboard.scene import RoadMap
from dashboard.scene.canvas import Canvas
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.view.build import build_view
from dashboard.view.model import PreviewView
from dashboard.web.pictures import Pictures
from slipstream import freshness
from slipstream.errors import InputError
from slipstream.messages import preview_key
from slipstream.roads import RoadNetwork
from slipstream.service import LogLimiter

log = logging.getLogger(__name__)

RESTART_AFTER_UPDATES: Final = 500_000
"""Updates after which the server is replaced; about three days with a browser connected."""
RETRY_AFTER_S: Final = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0)
"""Wait after each failed restart, s; the sum is below systemd's watchdog limit."""


class Page:
    """One viser server with the map and the panels on it.

    Raises:
        InputError: the address cannot be served on.
    """

    def __init__(
        self,
        settings: DashboardSettings,
        network: RoadNetwork,
        stopping: threading.Event,
        pictures: Pictures,
        operator_url: str | None = None,
        depots: Collection[str] = (),
    ) -> None:
        self._settings = settings
        self._depots = tuple(depots)
        self._pictures = pictures
        self._looks: dict[str, ExitStack] = {}
        self._port = settings.scene_port or 0
        self._network = network
        self._stopping = stopping
        self._operator_url = operator_url
        self._limiter = LogLimiter()
        self._browsers: dict[int, Browser] = {}
        self._server: viser.ViserServer
        self._serving = False
        self.client_connected = threading.Event()
        """Set when a browser has connected; the owner clears it."""
        self._build()

    def clients(self) -> int:
        """Number of connected browsers."""
        return len(self._server.get_clients())

    def show(self, live: LiveData, now_ns: int) -> None:
        """Update the page to the latest messages.

        Raises:
            OSError: another process took the address during a restart and kept it.
        """
        if not self._restart_server_if_due():
            return
        view = build_view(live.snapshot(), now_ns, self._settings.stale_after_s)
        drawn = self._map.update(view)
        self._panels.update(view)
        browsers = list(self._browsers.values())
        self._look_at({rsu for browser in browsers if (rsu := browser.picture_of()) is not None})
        for browser in browsers:
            try:
                browser.show(drawn, self._picture(browser.picture_of(), now_ns))
            except (ValueError, ArithmeticError, AssertionError, RuntimeError) as error:
                # What a browser sent of its camera is no fault of the others.
                if self._limiter.allow("browser"):
                    log.warning("a browser's labels were not updated: %.200s", error)
        self._updates += 1
        metrics.UPDATES.inc()
        metrics.CLIENTS.set(self.clients())

    def _look_at(self, rsus: set[str]) -> None:
        """Have the pictures of these units come, and no others."""
        for rsu in self._looks.keys() - rsus:
            self._looks.pop(rsu).close()
        for rsu in rsus - self._looks.keys():
            self._looks[rsu] = ExitStack()
            self._looks[rsu].enter_context(self._pictures.looking(preview_key(rsu)))

    def _picture(self, rsu: str | None, now_ns: int) -> PreviewView | None:
        found = None if rsu is None else self._pictures.latest(preview_key(rsu))
        if found is None:
            return None
        limit_s = self._settings.stale_after_s
        stale = freshness.fault(found.taken_ns, now_ns, stale_after_s=limit_s) is not None
        return PreviewView(found.jpeg, freshness.age_s(found.taken_ns, now_ns), stale)

    def close(self) -> None:
        """Stop serving."""
        if self._serving:
            self._serving = False
            stop_server(self._server)

    def _build(self) -> None:
        self._updates = 0
        self._browsers = {}
        settings = self._settings
        head = frame_html(Canvas(self._network).scale)
        self._server = start_server(settings.host, self._port, settings.allowed_hosts, head)
        try:
            self._map = RoadMap(self._server, self._network, self._depots)
            self._panels = PanelLayout(self._server)
            places = self._server.gui.add_button_group("View", PLACES, order=VIEW_ORDER)
            places.on_click(self._on_place)
            self._server.on_client_connect(self._on_connect)
            self._server.on_client_disconnect(self._on_disconnect)
            self._serving = True
        except BaseException:
            stop_server(self._server)
            raise

    def _restart_server_if_due(self) -> bool:
        """Replace a server after `RESTART_AFTER_UPDATES`; False if the service stops meanwhile."""
        # For each new browser viser iterates over all messages it ever sent, 0.2 s a million: after
        # months no browser could connect. Browsers reconnect by themselves; a restart without any
        # is preferred.
        limit = RESTART_AFTER_UPDATES if self.clients() else RESTART_AFTER_UPDATES // 2
        if self._updates < limit:
            return True
        log.info("restarting the web server after %d updates", self._updates)
        self.close()
        for delay_s in RETRY_AFTER_S:
            try:
                self._build()
                return True
            except InputError as error:
                log.warning("%s; trying again in %g s", error, delay_s)
            if self._stopping.wait(delay_s):
                return False
        # No InputError, after which the service would not be restarted: the settings are valid, as
        # the daemon served here until now.
        raise OSError(
            f"{self._settings.host}:{self._port}: lost during a restart of the web server"
        )

    # Asynchronous, since what the connection's path asks for is known in its own tasks only.
    async def _on_connect(self, client: viser.ClientHandle) -> None:
        asked = selection.asked_for.get()
        browser = Browser(client, self._map, asked, self._operator_url)
        self._browsers[client.client_id] = browser
        self.client_connected.set()

    def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._browsers.pop(client.client_id, None)

    def _on_place(self, event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
        browser = self._browsers.get(-1 if event.client_id is None else event.client_id)
        if browser is not None:
            browser.go(event.target.value)
