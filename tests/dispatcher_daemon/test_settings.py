from __future__ import annotations

import pytest

from dispatcher_daemon.settings import DispatcherSettings
from slipstream.config import check
from slipstream.errors import InputError


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
        ({"hardware": {"poll_s": 90}}, "poll_s must not be above most_poll_s"),
        ({"hardware": {"rest_s": 1e6}}, "rest_s must not be above most_rest_s"),
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
