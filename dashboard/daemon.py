"""The dashboard's service: bus and database in, one web page out."""

from __future__ import annotations

import contextlib
import logging
import time
from typing import Final

from dashboard import metrics
from dashboard.feeds import HistoryFeed, PreviewFeed, subscribe
from dashboard.live import LiveData
from dashboard.page import Page
from dashboard.settings import DashboardSettings
from slipstream.admission import check_rsus, refusal
from slipstream.bus import Bus
from slipstream.service import LogLimiter, Service, configure_logging, rss_mb
from slipstream.sumo_net import load_network

log = logging.getLogger(__name__)

PERIOD_S: Final = 0.5
IDLE_PERIOD_S: Final = 5.0
"""Period of the page's updates with and without connected browsers, s."""


def run_dashboard(settings: DashboardSettings) -> None:
    """Serve the page until SIGTERM or SIGINT.

    Raises:
        InputError: the port is taken, or the network, the list of RSUs, the database URL or the
            bus is not usable.
        OSError: another process took the port during a restart of the server.
    """
    configure_logging("dashboard", settings.service)
    network = load_network(settings.network)
    limiter = LogLimiter()
    check_rsus(settings.rsus, network, "dashboard")
    live = LiveData(
        settings.history_cycles,
        time.time_ns,
        lambda message: refusal(message, network, settings.rsus),
    )
    with contextlib.ExitStack() as stack:
        history = None
        if settings.database_url is not None:
            url, cycles = settings.database_url, settings.history_cycles
            history = HistoryFeed(url, live, cycles, limiter)
            stack.callback(history.stop)
        service = stack.enter_context(Service("dashboard", settings.service))
        page = Page(settings, network, service.stopping)
        stack.callback(page.close)
        bus = stack.enter_context(Bus.open(settings.bus))
        previews = PreviewFeed(settings.bus, live, limiter)
        stack.callback(previews.set_active, False)
        subscribe(bus, live, limiter)
        if history is not None:
            history.start()
        log.info("serving http://%s:%d", settings.host, settings.port)
        service.ready()
        while not service.stopping.is_set():
            previews.set_active(page.clients() > 0)
            page.show(live, time.time_ns())
            metrics.RESIDENT_MB.set(rss_mb())
            service.progress(f"{page.clients()} browsers")
            _wait_for_update(service, page)


def _wait_for_update(service: Service, page: Page) -> None:
    """Wait for the next update; returns at once when a browser connects or the service stops."""
    until = time.monotonic() + (PERIOD_S if page.clients() else IDLE_PERIOD_S)
    while not page.client_connected.is_set() and (left := until - time.monotonic()) > 0:
        if service.wait(min(left, PERIOD_S)):
            return
    page.client_connected.clear()
