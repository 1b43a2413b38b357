"""The dashboard as a service: bus and database in, one web page out."""

from __future__ import annotations

import logging
import threading
import time
from typing import Final

import viser

from dashboard import metrics
from dashboard.feeds import HistoryFeed, PreviewFeed, subscribe
from dashboard.live import LiveData
from dashboard.map import RoadMap
from dashboard.panels import Panels
from dashboard.server import start_server, stop_server
from dashboard.settings import DashboardSettings
from dashboard.view_model import build_view
from slipstream.bus import Bus
from slipstream.roads import load_network
from slipstream.service import LogLimiter, Service, configure_logging, rss_mb

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.5
IDLE_PERIOD_S: Final = 5.0
"""How often the page is brought up to date with, and without, somebody looking at it."""


SETTLING_S: Final = 10.0
"""How long after its arrival a browser's view is fitted to its canvas."""


def run_dashboard(settings: DashboardSettings) -> None:
    """Serve the page until SIGTERM or SIGINT.

    Raises:
        InputError: the port is taken, or the network, the database URL or the bus is not usable.
    """
    configure_logging("dashboard", settings.service.log_level)
    network = load_network(settings.network)
    limiter = LogLimiter()
    live = LiveData(settings.history_cycles, time.time_ns)
    history = None
    if settings.database_url is not None:
        history = HistoryFeed(settings.database_url, live, settings.history_cycles, limiter)
    with Service("dashboard", settings.service) as service:
        server = start_server(settings.host, settings.port)
        try:
            with Bus.open(settings.bus) as bus:
                subscribe(bus, live, limiter)
                if history is not None:
                    history.start()
                page = Page(server, RoadMap(server, network, settings.depot), service)
                previews = PreviewFeed(settings.bus, live, limiter)
                log.info("serving http://%s:%d", settings.host, settings.port)
                service.ready()
                try:
                    while not service.stopping.is_set():
                        previews.watch(page.clients() > 0)
                        page.show(live, settings)
                        service.progress(f"{page.clients()} browsers")
                        page.wait()
                finally:
                    previews.watch(False)
        finally:
            if history is not None:
                history.stop()
            stop_server(server)


class Page:
    """The page and the browsers that look at it.

    Args:
        server: the viser server, not yet drawn on but for the map.
        road_map: the map on it.
        service: whose end ends a `wait`.
    """

    def __init__(self, server: viser.ViserServer, road_map: RoadMap, service: Service) -> None:
        self._server = server
        self._map = road_map
        self._service = service
        self._panels = Panels(server)
        self._wake = threading.Event()
        server.on_client_connect(self._welcome)

    def clients(self) -> int:
        """How many browsers are connected."""
        return len(self._server.get_clients())

    def show(self, live: LiveData, settings: DashboardSettings) -> None:
        """Bring the page up to date with the latest messages."""
        view = build_view(
            live.snapshot(),
            time.time_ns(),
            stale_after_s=settings.stale_after_s,
            silent_after_s=settings.silent_after_s,
        )
        self._map.update(view)
        self._panels.update(view)
        metrics.UPDATES.inc()
        metrics.CLIENTS.set(self.clients())
        metrics.RESIDENT_MB.set(rss_mb())

    def wait(self) -> None:
        """Until the next update is due: sooner when a browser arrives, or the service stops."""
        until = time.monotonic() + (PERIOD_S if self.clients() else IDLE_PERIOD_S)
        while not self._wake.is_set() and (left := until - time.monotonic()) > 0:
            if self._service.wait(min(left, PERIOD_S)):
                return
        self._wake.clear()

    def _welcome(self, client: viser.ClientHandle) -> None:
        arrived = time.monotonic()
        fitted: tuple[int, int] | None = None

        def fit(camera: viser.CameraHandle) -> None:
            # The canvas shrinks while the browser is still placing the panels beside it; after
            # that the camera is the user's.
            nonlocal fitted
            canvas = (camera.image_width, camera.image_height)
            if canvas == fitted or time.monotonic() - arrived > SETTLING_S:
                return
            fitted = canvas
            position, look_at = self._map.fit(*canvas)
            with client.atomic():
                camera.up_direction = (0.0, 1.0, 0.0)
                camera.position = position
                camera.look_at = look_at

        client.camera.on_update(fit)
        fit(client.camera)
        self._wake.set()
