"""Settings of the dashboard."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from slipstream.admission import Rsus
from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.freshness import STALE_AFTER_S
from slipstream.sumo_net import DEMO_NETWORK

HOST_NAME = r"^([A-Za-z0-9._-]+|[0-9A-Fa-f:.]+)$"
"""A DNS name or an IP address."""


class DashboardSettings(Settings):
    """The dashboard's bus, database, network and address."""

    bus: BusSettings = Field(default=BusSettings(), description="How to reach the other daemons.")
    service: ServiceSettings = Field(default=ServiceSettings(), description="Metrics and logs.")
    network: str = Field(
        default=DEMO_NETWORK, description="Road network to draw: a SUMO net, or 'demo'."
    )
    rsus: Rsus | None = Field(
        default=None,
        description="The segments that each RSU watches, as in the dispatcher's settings; others' "
        "states are not drawn.",
    )
    depots: tuple[str, ...] = Field(
        default=("depot",),
        description="Junctions to mark as depots; unknown ones are not drawn.",
    )
    database_url: str | None = Field(
        default="sqlite:///slipstream.db",
        description="The dispatcher's database, for the history; read only. It need not exist yet.",
    )
    host: str = Field(
        default="127.0.0.1",
        description="Address to serve on. The page has no login: share it through a proxy.",
    )
    port: int = Field(default=8080, ge=1, le=65535, description="TCP port to serve on.")
    allowed_hosts: tuple[Annotated[str, Field(pattern=HOST_NAME)], ...] = Field(
        default=(),
        description="Names or addresses under which a reverse proxy serves the page, without "
        "scheme and port. Requests for other names than these, the served address and loopback "
        "get HTTP 403, and so do those that other sites' pages send.",
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="Age limit of RSU health and pictures, s. Road data has the limit that the "
        "dispatcher publishes, and this one before its first health message.",
    )
    silent_after_s: float = Field(
        default=30.0,
        gt=0,
        allow_inf_nan=False,
        description="A dispatcher without health for longer is shown as silent, s.",
    )
    history_cycles: int = Field(
        default=200, ge=2, le=5000, description="Cycles shown in the energy history."
    )
