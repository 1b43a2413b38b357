"""Settings of the dashboard."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from pydantic import Field, field_validator, model_validator

from slipstream.config import BusSettings, ServiceSettings, Settings
from slipstream.freshness import STALE_AFTER_S
from slipstream.prices import ENERGY_PRICE_PER_KWH
from slipstream.roads.admission import Rsus
from slipstream.roads.sumo_net import DEMO_NETWORK

HOST_NAME = r"^([A-Za-z0-9._-]+|[0-9A-Fa-f:.]+)$"
"""A DNS name or an IP address."""


class Factors(NamedTuple):
    """What a kilowatt hour is worth: CO2 that is emitted for it, and its price in the currency."""

    co2_kg_per_kwh: float
    price_per_kwh: float


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
    fleet: Path | None = Field(
        default=None,
        description="The fleet's file, as in the dispatcher's settings: its depots are marked, and "
        "all its vehicles are listed. Null: `depots`, and the vehicles that were heard of.",
    )
    depots: tuple[str, ...] = Field(
        default=("depot",),
        description="Junctions to mark as depots where no `fleet` is given; unknown ones are not "
        "drawn.",
    )
    database_url: str | None = Field(
        default="sqlite:///slipstream.db",
        description="The dispatcher's database, for the history; read only. It need not exist yet.",
    )
    host: str = Field(
        default="127.0.0.1",
        description="Address to serve on. The page has no login: share it through a proxy.",
    )
    port: int = Field(default=8080, ge=1, le=65535, description="TCP port of the operator's page.")
    scene_port: int | None = Field(
        default=8081, ge=1, le=65535, description="TCP port of the 3D view; null: there is none."
    )
    scene_url: str | None = Field(
        default=None,
        pattern=r"^https?://",
        description="Where browsers reach the 3D view; null: at `scene_port` of the page's host.",
    )
    title: str = Field(
        default="Slipstream", min_length=1, max_length=100, description="Of the operator's page."
    )
    units: Literal["metric", "imperial"] = Field(
        default="metric", description="Units of speed and distance on the operator's page."
    )
    time_zone: str | None = Field(
        default=None,
        description="Time zone of the page's clocks and days, as Europe/Berlin; null: of each "
        "browser, and days of the server's.",
    )
    allowed_hosts: tuple[Annotated[str, Field(pattern=HOST_NAME)], ...] = Field(
        default=(),
        description="Names or addresses under which a reverse proxy serves the page, without "
        "scheme and port. Requests for other names than these, the served address and loopback "
        "get HTTP 403, and so do those that other sites' pages send.",
    )
    allow_control: bool = Field(
        default=False,
        description="Show the page's actions, and hand them on to the dispatcher with the caller's "
        "token. `--allow-control` sets it.",
    )
    dispatcher_api: str = Field(
        default="http://127.0.0.1:8090",
        pattern=r"^https?://",
        description="The dispatcher's HTTP API, for actions.",
    )
    co2_kg_per_kwh: float = Field(
        default=0.21,
        ge=0,
        allow_inf_nan=False,
        description="CO2 of a kilowatt hour from the grid, kg: 0.21 is about the European Union's "
        "mean of 2023 (European Environment Agency, greenhouse gas emission intensity of "
        "electricity generation); put in your supplier's.",
    )
    price_per_kwh: float = Field(
        default=ENERGY_PRICE_PER_KWH,
        ge=0,
        allow_inf_nan=False,
        description="Price of a kilowatt hour: 0.20 EUR is what non-household consumers in the "
        "European Union paid on average in the second half of 2023, without VAT (Eurostat, "
        "electricity price statistics); put in your own, as in the dispatcher's "
        "`prices.energy_kwh`.",
    )
    currency: str = Field(
        default="EUR", min_length=1, max_length=10, description="Of `price_per_kwh`."
    )
    stale_after_s: float = Field(
        default=STALE_AFTER_S,
        gt=0,
        allow_inf_nan=False,
        description="Age limit of RSU health and pictures, s. Road data has the limit that the "
        "dispatcher publishes, and this one before its first health message.",
    )

    @property
    def factors(self) -> Factors:
        """What a kilowatt hour saved is worth."""
        return Factors(self.co2_kg_per_kwh, self.price_per_kwh)

    @model_validator(mode="after")
    def _ports_differ(self) -> Self:
        if self.scene_port == self.port:
            raise ValueError("scene_port must not be port")
        return self

    @field_validator("time_zone")
    @classmethod
    def _zone_is_known(cls, name: str | None) -> str | None:
        try:
            if name is not None:
                ZoneInfo(name)
        except (ZoneInfoNotFoundError, ValueError, OSError):
            raise ValueError("no such time zone: name one as Europe/Berlin") from None
        return name
