"""The dashboard's service: bus and database in, the operator's page and the 3D view out."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Final

import storage
from dashboard import metrics
from dashboard.feeds import HistoryFeed, listen_to_pictures, subscribe
from dashboard.live import LiveData
from dashboard.settings import DashboardSettings
from dashboard.web.energy import EnergyBook, zone_of
from dashboard.web.hub import PageHub
from dashboard.web.past import StoredPast
from dashboard.web.pictures import Pictures
from dashboard.web.routes.present import Present
from dashboard.web.tables.fleet_file import make_scene
from dashboard.web.tables.rows import Scene
from dashboard.web.tables.tables import PageTables
from slipstream.bus import Bus
from slipstream.errors import InputError
from slipstream.http.server import HttpServer
from slipstream.roads import RoadNetwork
from slipstream.roads.admission import check_rsus, refusal
from slipstream.roads.sumo_net import load_network
from slipstream.service import LogLimiter, Service, configure_logging, rss_mb
from slipstream.service.memory import configure_allocator, keep_loaded

if TYPE_CHECKING:
    from dashboard.page import Page

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.5
IDLE_PERIOD_S: Final = 5.0
"""Period of the 3D view's updates with and without connected browsers, s."""
STUCK_AFTER_S: Final = 30.0
"""The page counts as stuck where it has not been brought up to date for so long."""


def run_dashboard(settings: DashboardSettings) -> None:
    """Serve both pages until SIGTERM or SIGINT.

    Raises:
        InputError: a port is taken, or the network, the fleet's file, the list of RSUs, the
            database URL or the bus is not usable.
        OSError: another process took the 3D view's port during a restart of its server.
    """
    configure_allocator()
    configure_logging("dashboard", settings.service)
    network = load_network(settings.network)
    scene = make_scene(network, settings.fleet, settings.depots)
    limiter = LogLimiter()
    check_rsus(settings.rsus, network, "dashboard")
    live = LiveData(time.time_ns, lambda message: refusal(message, network, settings.rsus))
    pictures = Pictures()
    with Service("dashboard", settings.service) as service:
        reader = history = past = None
        if settings.database_url is not None:
            url = settings.database_url
            reader = service.start("database", partial(storage.open_reader, url))
            past = _past(settings, scene, reader, live.watched)
            history = HistoryFeed(url, live, limiter, past.energy.refresh)
            service.on_stop("history", history.stop)
        server = service.start("the operator's page", partial(_open_server, settings))
        bus = service.start("bus", partial(Bus.open, settings.bus), Bus.fault)
        subscribe(bus, live, limiter, settings.rsus)
        if history is not None:
            history.start()
        hub = PageHub()
        tables = PageTables(
            scene,
            stale_after_s=settings.stale_after_s,
            factors=settings.factors,
            rsus=settings.rsus,
        )
        present = Present(
            live,
            tables,
            hub,
            lambda: bus.is_connected,
            lambda: None if past is None else past.energy.latest,
        )
        service.on_stop("rows of the page", present.stop)
        service.on_stop("browsers", hub.close_all)
        listen_to_pictures(bus, pictures, limiter)
        service.on_stop("pictures", lambda: pictures.listen_by(None))
        present.start()
        # The web framework takes half a second to import: messages come in meanwhile.
        from dashboard.web.app import make_app
        from dashboard.web.services import PageServices

        server.start(
            make_app(PageServices(settings, scene, present.known, hub, pictures, past, reader))
        )
        log.info("serving http://%s:%d", settings.host, server.port)
        page = None
        if settings.scene_port is not None:
            # Behind a proxy both are of one site.
            own = f"http://{settings.host}:{settings.port}" if settings.scene_url is None else ""
            depots = scene.depots.values()
            open_page = partial(
                _open_page, settings, network, service.stopping, pictures, own, depots
            )
            page = service.start("the 3D view", open_page)
        keep_loaded()
        service.ready()
        shown = False
        while not service.stopping.is_set():
            clients = 0 if page is None else page.clients()
            if page is not None and (clients or not shown):
                page.show(live, time.time_ns())
                # Once more after the last one has gone: it asks for no pictures any more.
                shown = not clients
            metrics.RESIDENT_MB.set(rss_mb())
            if time.monotonic() - present.progress_at < STUCK_AFTER_S:
                service.progress(f"{hub.viewers} browsers, {clients} of the 3D view")
            _wait_for_update(service, page)


def show_finished_run(settings: DashboardSettings) -> None:
    """Serve the operator's page of a database that nobody writes any more, until SIGTERM or SIGINT.

    Raises:
        InputError: the port is taken, the network, the fleet's file or the database URL is not
            usable, no run is stored there, or it was none in this network.
        StorageError: the database cannot be read.
    """
    configure_allocator()
    configure_logging("dashboard", settings.service)
    network = load_network(settings.network)
    scene = make_scene(network, settings.fleet, settings.depots)
    check_rsus(settings.rsus, network, "dashboard")
    url = settings.database_url or ""
    with Service("dashboard", settings.service) as service:
        reader = service.start("database", partial(storage.open_reader, url))
        past = _past(settings, scene, reader, dict)
        span = past.span()
        if span is None:
            raise InputError(url, "no cycle is stored there", "give the database of a run")
        last_ns = span[1]
        roads = past.at(last_ns).moment["roads"]
        if roads and not any(road in network.segments for road in roads):
            mend = "give the run's with --network"
            raise InputError(settings.network, "it has none of the run's roads", mend)
        server = service.start("the operator's page", partial(_open_server, settings))
        from dashboard.web.app import make_app
        from dashboard.web.services import PageServices

        services = PageServices(settings, scene, lambda: past.at(last_ns), past=past, reader=reader)
        server.start(make_app(services))
        log.info("serving http://%s:%d", settings.host, server.port)
        service.ready()
        while not service.wait(IDLE_PERIOD_S):
            metrics.RESIDENT_MB.set(rss_mb())
            service.progress("a finished run is shown")


def _open_server(settings: DashboardSettings) -> closing[HttpServer]:
    """The page's port is taken; nothing is served yet."""
    return closing(
        HttpServer(
            "the operator's page",
            settings.host,
            settings.port,
            "port",
            refused=lambda status: metrics.REQUESTS.labels(str(status)).inc(),
            failed=metrics.FAILURES.inc,
        )
    )


def _open_page(
    settings: DashboardSettings,
    network: RoadNetwork,
    stopping: threading.Event,
    pictures: Pictures,
    operator_url: str,
    depots: Collection[str],
) -> closing[Page]:
    # Last of all, as it takes as long to load as the operator's page.
    from dashboard.page import Page

    return closing(Page(settings, network, stopping, pictures, operator_url, depots))


def _past(
    settings: DashboardSettings,
    scene: Scene,
    reader: storage.Reader,
    heard: Callable[[], Mapping[str, Sequence[str]]],
) -> StoredPast:
    zone = zone_of(settings.time_zone)
    energy = EnergyBook(reader, zone, settings.factors)
    return StoredPast(reader, scene, energy, settings.rsus, heard)


def _wait_for_update(service: Service, page: Page | None) -> None:
    """Wait for the next update; returns at once when a browser connects or the service stops."""
    until = time.monotonic() + (PERIOD_S if page is not None and page.clients() else IDLE_PERIOD_S)
    while (left := until - time.monotonic()) > 0:
        if page is not None and page.client_connected.is_set():
            break
        if service.wait(min(left, PERIOD_S)):
            return
    if page is not None:
        page.client_connected.clear()
