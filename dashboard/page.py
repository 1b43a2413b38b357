"""The page: one viser server with map and panels, its clients and its restart."""

from __future__ import annotations

import logging
import threading
import time
from typing import Final

import viser

from dashboard import metrics
from dashboard.live import LiveData
from dashboard.panels import PanelLayout
from dashboard.scene import RoadMap
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.view import build_view
from slipstream.errors import InputError
from slipstream.roads import RoadNetwork

log = logging.getLogger(__name__)

FIT_CAMERA_FOR_S: Final = 10.0
"""Time after a browser connects in which its camera is fitted to its canvas, s."""
MAX_CANVAS_PX: Final = 65536
"""Sides of a canvas that a camera is fitted to, px; larger ones are no browser's."""
RESTART_AFTER_UPDATES: Final = 500_000
"""Updates after which the server is replaced; about three days with a browser connected."""
RETRY_AFTER_S: Final = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0)
"""Wait after each failed restart, s; the sum is below systemd's watchdog limit."""


class Page:
    """One viser server with the map and the panels on it.

    Args:
        settings: address and age limits.
        network: the road network to draw.
        stopping: set when the service is to stop; ends the wait for an address.

    Raises:
        InputError: the address cannot be served on.
    """

    def __init__(
        self, settings: DashboardSettings, network: RoadNetwork, stopping: threading.Event
    ) -> None:
        self._settings = settings
        self._network = network
        self._stopping = stopping
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
        view = build_view(
            live.snapshot(),
            now_ns,
            stale_after_s=self._settings.stale_after_s,
            silent_after_s=self._settings.silent_after_s,
        )
        self._map.update(view)
        self._panels.update(view)
        self._updates += 1
        metrics.UPDATES.inc()
        metrics.CLIENTS.set(self.clients())

    def close(self) -> None:
        """Stop serving."""
        if self._serving:
            self._serving = False
            stop_server(self._server)

    def _build(self) -> None:
        self._updates = 0
        settings = self._settings
        self._server = start_server(settings.host, settings.port, settings.allowed_hosts)
        try:
            self._map = RoadMap(self._server, self._network, self._settings.depots)
            self._panels = PanelLayout(self._server)
            self._server.on_client_connect(self._on_connect)
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
            f"{self._settings.host}:{self._settings.port}: lost during a restart of the web server"
        )

    def _on_connect(self, client: viser.ClientHandle) -> None:
        arrived = time.monotonic()
        fitted: tuple[int, int] | None = None

        def fit(camera: viser.CameraHandle) -> None:
            # The canvas shrinks while the browser lays out the panels; afterwards only the user
            # moves the camera.
            nonlocal fitted
            canvas = (camera.image_width, camera.image_height)
            if canvas == fitted or time.monotonic() - arrived > FIT_CAMERA_FOR_S:
                return
            # A client may send any number of digits; viser would print the traceback.
            if max(canvas) > MAX_CANVAS_PX:
                return
            fitted = canvas
            position, look_at = self._map.fit(*canvas)
            with client.atomic():
                camera.up_direction = (0.0, 1.0, 0.0)
                camera.position = position
                camera.look_at = look_at

        client.camera.on_update(fit)
        fit(client.camera)
        self.client_connected.set()
