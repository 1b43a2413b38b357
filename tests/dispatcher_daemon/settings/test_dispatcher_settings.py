from __future__ import annotations

import pytest

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import AdviceSettings, DispatcherSettings
from slipstream.config import Settings, check
from slipstream.errors import InputError
from slipstream.messages import DrivingAdvice
from slipstream.prices import PriceSettings
from slipstream_cli.settings_doc import sections


def test_defaults_run_the_demo() -> None:
    """Without any setting the built-in network and fleet are used, every 30 s."""
    settings = DispatcherSettings()
    assert (settings.network, settings.fleet, settings.interval_s) == ("demo", "demo", 30.0)
    assert settings.solvers == ("exact", "lc-qaoa")
    assert settings.hardware.backend == ""


@pytest.mark.parametrize(
    ("data", "part"),
    [
        ({"interval_s": 10, "deadline_s": 10}, "must be below interval_s"),
        ({"interval_s": "soon"}, "interval_s"),
        ({"solvers": []}, "solvers"),
        ({"solvers": ["exact", "exact"]}, "named twice"),
        ({"solvers": ["magic"]}, "solvers.0"),
        ({"gamma": 0}, "gamma"),
        ({"sync_window_s": float("nan")}, "sync_window_s"),
        ({"sync_windows": 3}, "unknown key"),
        ({"lc_qaoa": {"shots": 0}}, "lc_qaoa.shots"),
        ({"lc_qaoa": {"backend": "ibm:least-busy"}}, "lc_qaoa.backend"),
        ({"hardware": {"backend": "boston"}}, "hardware.backend"),
        ({"hardware": {"backend": "ibm:"}}, "hardware.backend"),
        ({"hardware": {"backend": "aer:FakeBoston"}}, "hardware.backend"),
        ({"hardware": {"token": "secret"}}, "hardware.token: unknown key"),
        ({"hardware": {"budget_s_per_day": 0}}, "hardware.budget_s_per_day"),
        (
            {"hardware": {"backend": "ibm:least-busy"}, "solvers": ["exact"]},
            "add it to solvers",
        ),
    ],
)
def test_bad_settings_are_named(data: dict[str, object], part: str) -> None:
    """A bad setting is refused in one line that names it."""
    with pytest.raises(InputError, match=part) as caught:
        check(data, DispatcherSettings, "dispatcher.toml")
    assert str(caught.value).startswith("dispatcher.toml")
    assert "\n" not in str(caught.value)


SHARED = ("bus", "service")
"""Sections that other rooms define."""


def test_every_key_has_a_description() -> None:
    """No key of the dispatcher's own settings is left without one."""

    def undescribed(model: type[Settings], path: str) -> list[str]:
        missing = []
        for name, field in model.model_fields.items():
            inner = field.annotation
            if not field.description:
                missing.append(path + name)
            if isinstance(inner, type) and issubclass(inner, Settings) and name not in SHARED:
                missing += undescribed(inner, f"{path}{name}.")
        return missing

    assert undescribed(DispatcherSettings, "") == []


def test_advice_has_the_price_of_driving_unless_it_has_its_own() -> None:
    """Departure seconds are chosen by the same price of time as routes."""
    prices = PriceSettings(energy_kwh=0.25, driving_hour=5.0)
    advice = AdviceSettings(departure_window_s=32.0)
    priced = DispatcherSettings(prices=prices, advice=advice).priced_advice
    assert priced == DrivingAdvice(departure_window_s=32.0, value_of_time_kw=20.0)
    own = AdviceSettings(value_of_time_kw=10.0)
    priced = DispatcherSettings(prices=prices, advice=own).priced_advice
    assert priced == DrivingAdvice(value_of_time_kw=10.0)


def test_a_printed_default_is_the_one_in_force() -> None:
    """No price of time is printed, as it is that of driving: none that the daemon never takes."""
    printed = {key.path: key.default for part in sections(DispatcherSettings) for key in part.keys}
    in_force = DispatcherSettings().priced_advice.model_dump()
    assert printed["advice.value_of_time_kw"] == "–"
    for name in in_force.keys() - {"value_of_time_kw"}:
        assert printed[f"advice.{name}"].strip("`") == str(in_force[name]).lower()


def test_a_kilowatt_hour_has_one_price() -> None:
    """What routes are weighed by is what the page counts savings with."""
    assert PriceSettings().energy_kwh == DashboardSettings.model_fields["price_per_kwh"].default
