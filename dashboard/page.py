"""The page and the browsers that look at it."""

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
"""How long after its arrival a browser's view is fitted to its canvas."""
RESTART_AFTER_UPDATES: Final = 500_000
"""Updates after which the server is replaced; some three days of somebody looking."""
RETRY_AFTER_S: Final = (0.5, 1.0, 2.0, 4.0, 8.0, 15.0)
"""How long to wait after each failure to serve again; in sum below systemd's watchdog."""


class Page:
    """One viser server with the map and the panels on it.

    Args:
        settings: where to serve, what counts as stale.
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
        """Set when a browser has arrived; the owner clears it."""
        self._build()

    def clients(self) -> int:
        """How many browsers are connected."""
        return len(self._server.get_clients())

    def show(self, live: LiveData, now_ns: int) -> None:
        """Bring the page up to date with the latest messages.

        Raises:
            OSError: the address was lost while the server was renewed, and not free again in time.
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
        self._server = start_server(self._settings.host, self._settings.port)
        try:
            self._map = RoadMap(self._server, self._network, self._settings.depots)
            self._panels = PanelLayout(self._server)
            self._server.on_client_connect(self._on_connect)
            self._serving = True
        except BaseException:
            stop_server(self._server)
            raise

    def _restart_server_if_due(self) -> bool:
        """False where there is no server any more, as the service is stopping."""
        # For each new browser viser counts through all messages there ever were, 0.2 s a million:
        # after months nobody would get in. Browsers come back to the new server by themselves, but
        # it is better done while there are none.
        limit = RESTART_AFTER_UPDATES if self.clients() else RESTART_AFTER_UPDATES // 2
        if self._updates < limit:
            return True
        log.info("renewing the page after %d updates", self._updates)
        self.close()
        for delay_s in RETRY_AFTER_S:
            try:
                self._build()
                return True
            except InputError as error:
                log.warning("%s; trying again in %g s", error, delay_s)
            if self._stopping.wait(delay_s):
                return False
        # No mistake of the user's any more: the daemon served here until now. Not an InputError,
        # then, after which it would not be started again.
        raise OSError(
            f"{self._settings.host}:{self._settings.port}: lost while the page was renewed"
        )

    def _on_connect(self, client: viser.ClientHandle) -> None:
        arrived = time.monotonic()
        fitted: tuple[int, int] | None = None

        def fit(camera: viser.CameraHandle) -> None:
            # The canvas shrinks while the browser is still placing the panels beside it; after
            # that the camera is the user's.
            nonlocal fitted
            canvas = (camera.image_width, camera.image_height)
            if canvas == fitted or time.monotonic() - arrived > FIT_CAMERA_FOR_S:
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
