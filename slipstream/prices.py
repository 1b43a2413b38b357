"""What a kilowatt hour and an hour cost."""

from __future__ import annotations

from typing import Final

from pydantic import Field

from slipstream.config import Settings

ENERGY_PRICE_PER_KWH: Final = 0.20
"""EUR: what non-household consumers in the European Union paid on average in the second half of
2023, without VAT (Eurostat, electricity price statistics).
"""


class PriceSettings(Settings):
    """What the objective weighs against energy (``[prices]``), in one currency."""

    energy_kwh: float = Field(
        default=ENERGY_PRICE_PER_KWH,
        gt=0,
        le=1e6,
        allow_inf_nan=False,
        description="A kWh of energy, in routes and on the page: 0.20 EUR is what non-household "
        "consumers in the European Union paid on average in the second half of 2023, without VAT "
        "(Eurostat, electricity price statistics); put in your own.",
    )
    driving_hour: float = Field(
        default=0.40,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="An hour of driving, such as a wage. 0: only energy counts.",
    )
    waiting_hour: float = Field(
        default=0.0,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="An hour of waiting for other vehicles at the depot, within the departure "
        "window, or at a hub. 0: a wait is free.",
    )
    standing_hour: float | None = Field(
        default=None,
        ge=0,
        le=1e6,
        allow_inf_nan=False,
        description="An hour of waiting for other vehicles at a stop that has been served; its "
        "driver is paid. Not given: as driving costs, or as waiting if that is more.",
    )

    currency: str = Field(default="EUR", min_length=1, max_length=10, description="Of all prices.")

    @property
    def price_of_time_kw(self) -> float:
        """Of driving: kWh an hour."""
        return self.driving_hour / self.energy_kwh

    @property
    def price_of_waiting_kw(self) -> float:
        """Of waiting: kWh an hour."""
        return self.waiting_hour / self.energy_kwh

    @property
    def standing_kw(self) -> float | None:
        """Of waiting at a stop: kWh an hour; None: no price of its own."""
        return None if self.standing_hour is None else self.standing_hour / self.energy_kwh
