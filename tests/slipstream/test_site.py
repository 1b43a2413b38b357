"""One site.toml: what is shared stands once, and each daemon reads its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from dashboard.settings import DashboardSettings
from dispatcher_daemon.settings import DispatcherSettings
from edge_daemon.settings import EdgeSettings
from slipstream.errors import InputError
from slipstream.site import load_site
from vehicle_agent.settings import AgentSettings

SITE: dict[str, Any] = {
    "network": "town.net.xml",
    "fleet": "fleet.toml",
    "database_url": "sqlite:///x.db",
    "stale_after_s": 4.0,
    "prices": {"energy_kwh": 0.35, "currency": "CHF"},
    "bus": {"connect": ["tcp/10.0.0.1:7447"], "password_file": "bus-password"},
    "service": {"log_level": "WARNING"},
    "rsus": {
        "north": {
            "segments": ["a"],
            "camera": "n.toml",
            "source": {"url": "rtsp://n/"},
            "stability": {"keep_s": 9.0},
        },
        "south": {"segments": ["b"], "camera": "s.toml", "source": {"url": "rtsp://s/"}},
        "elsewhere": {"segments": ["c"]},
    },
    "edge": {"metrics_port": 9464, "stability": {"min_vehicles": 4, "keep_s": 1.0}},
    "dispatcher": {"interval_s": 20.0, "metrics_port": 9465},
    "dashboard": {"title": "Town"},
    "agents": {"vans": {"vehicles": [{"id": "van-1"}]}},
}


def written(folder: Path, **changes: Any) -> Path:
    """The site with some tables replaced."""
    path = folder / "site.toml"
    path.write_text(tomli_w.dumps(SITE | changes))
    return path


def test_each_daemon_has_what_is_shared_and_its_own(tmp_path: Path) -> None:
    """Prices, staleness, bus, logs and segments from the top; ports from the sections."""
    path = written(tmp_path)
    dispatcher = load_site(path, "dispatcher", DispatcherSettings)
    page = load_site(path, "dashboard", DashboardSettings)
    agents = load_site(path, "agent", AgentSettings)
    assert dispatcher.rsus == {"north": ("a",), "south": ("b",), "elsewhere": ("c",)} == page.rsus
    assert (dispatcher.network, dispatcher.interval_s) == ("town.net.xml", 20.0)
    assert (page.fleet, page.title) == (Path("fleet.toml"), "Town")
    assert (page.price_per_kwh, page.currency) == (dispatcher.prices.energy_kwh, "CHF")
    assert {s.stale_after_s for s in (dispatcher, page, agents)} == {4.0}
    assert dispatcher.service.metrics_port == 9465
    assert page.service.log_level == "WARNING"
    assert [s.bus.user for s in (dispatcher, page, agents)] == [
        "dispatcher",
        "dashboard",
        "agent-vans",
    ]


def test_an_rsus_own_keys_go_before_those_of_all(tmp_path: Path) -> None:
    """Key by key, also in inner tables; of several units one has to be named."""
    path = written(tmp_path)
    north = load_site(path, "edge", EdgeSettings, "north")
    south = load_site(path, "edge", EdgeSettings, "south")
    assert (north.rsu, north.camera, north.bus.user) == ("north", Path("n.toml"), "edge-north")
    assert (north.stability.keep_s, south.stability.keep_s) == (9.0, 1.0)
    assert north.stability.min_vehicles == south.stability.min_vehicles == 4
    with pytest.raises(InputError, match=r"--rsu: .* has north, south; name one"):
        load_site(path, "edge", EdgeSettings)
    with pytest.raises(InputError, match=r"rsus.west: no such table; give one of: north, south"):
        load_site(path, "edge", EdgeSettings, "west")
    alone = written(tmp_path, rsus={"north": SITE["rsus"]["north"]})
    assert load_site(alone, "edge", EdgeSettings) == north


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"networks": "x"}, "networks: unknown key; did you mean network?"),
        ({"dispatcher": {"interval": 3.0}}, "dispatcher.interval: unknown key; did you mean"),
        ({"dispatcher": {"network": "x"}}, "dispatcher.network: stands once, at the top"),
        ({"dispatcher": {"interval_s": "x"}}, "dispatcher.interval_s: "),
        ({"dispatcher": {"interval_s": 1.0}}, "dispatcher: deadline_s"),
        ({"dispatcher": {"metrics_port": 70000}}, "dispatcher.metrics_port: "),
        ({"dispatcher": {"api": {"port": -1}}}, "dispatcher.api.port: "),
        ({"dispatcher": {"gamma": 1.0}}, "dispatcher.gamma: unknown key"),
        ({"dispatcher": {"city": {"wave": 2}}}, "dispatcher.city.wave: unknown key"),
        ({"prices": {"energy_kwh": 0.0}}, "prices.energy_kwh: "),
        ({"bus": {"user": "me"}}, "bus.user: unknown key"),
        ({"rsus": {"n": {"camera": "c"}}}, "rsus.n.segments: missing key"),
    ],
)
def test_a_fault_names_table_and_key(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    """As they stand in the file."""
    path = written(tmp_path, **changes)
    with pytest.raises(InputError) as caught:
        load_site(path, "dispatcher", DispatcherSettings)
    assert str(caught.value).startswith(f"{path}: {said}")


def test_effort_is_less_or_more_work_and_normal_the_defaults() -> None:
    """What settings say themselves goes before."""
    fast, normal, thorough = (
        DispatcherSettings.model_validate({"effort": effort})
        for effort in ("fast", "normal", "thorough")
    )
    assert normal == DispatcherSettings()
    rounds = [s.city.search.rounds for s in (fast, normal, thorough)]
    assert rounds == sorted(set(rounds))
    given = {"effort": "fast", "city": {"search": {"rounds": 7}}}
    assert DispatcherSettings.model_validate(given).city.search.rounds == 7
    again = DispatcherSettings.model_validate(fast.model_dump())
    assert again == fast
