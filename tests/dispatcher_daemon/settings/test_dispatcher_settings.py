from __future__ import annotations

import pytest
from pydantic import ValidationError

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import AdviceSettings, DispatcherSettings
from slipstream.config import check
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


def test_advice_has_the_price_of_driving() -> None:
    """Departure seconds are chosen by the same price of time as routes."""
    prices = PriceSettings(energy_kwh=0.25, driving_hour=5.0)
    advice = AdviceSettings(eco_approach=False, coasting_budget=0.0, departure_window_s=32.0)
    priced = DispatcherSettings(prices=prices, advice=advice).priced_advice
    assert priced == DrivingAdvice(departure_window_s=32.0, value_of_time_kw=20.0)


def test_what_saves_without_a_city_is_on_by_default() -> None:
    """Eco-approach and coasting are; signals are asked by one key; no departure waits. A plan that
    says nothing of it has none.
    """
    assert DispatcherSettings().priced_advice == DrivingAdvice(
        eco_approach=True, coasting_budget=0.06, value_of_time_kw=2.0
    )
    data = {"advice": {"signal_priority": True}}
    assert check(data, DispatcherSettings, "site.toml").priced_advice == DrivingAdvice(
        eco_approach=True, coasting_budget=0.06, signal_priority=True, value_of_time_kw=2.0
    )
    said_nothing = DrivingAdvice()
    assert not said_nothing.eco_approach
    assert (said_nothing.coasting_budget, said_nothing.value_of_time_kw) == (0.0, None)


def test_a_window_without_a_price_is_refused() -> None:
    """Nobody guesses what a second costs."""
    with pytest.raises(ValidationError, match="departure_window_s needs value_of_time_kw"):
        DrivingAdvice(departure_window_s=32.0)


def test_a_printed_default_is_the_one_in_force() -> None:
    """All but the price of time, which is that of driving, and a constant."""
    printed = {key.path: key.default for part in sections(DispatcherSettings) for key in part.keys}
    in_force = DispatcherSettings().priced_advice.model_dump()
    derived = {"value_of_time_kw", "departure_window_s"}
    of_advice = {path for path in printed if path.startswith("advice.")}
    assert of_advice == {f"advice.{name}" for name in in_force.keys() - derived}
    for path in of_advice:
        assert printed[path].strip("`") == str(in_force[path.removeprefix("advice.")]).lower()


def test_a_kilowatt_hour_has_one_price() -> None:
    """What routes are weighed by is what the page counts savings with."""
    assert PriceSettings().energy_kwh == DashboardSettings.model_fields["price_per_kwh"].default
