"""`slipstream feed`: the documents of a finished run."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path

import pytest
from lxml import etree

from slipstream_cli.main import main
from storage import open_database
from tests.dispatcher_daemon.service.feeds.conftest import TROY
from tests.storage.conftest import _cycle

ROA = "{http://datex2.eu/schema/3/roadTrafficData}"


@pytest.fixture
def url(tmp_path: Path) -> str:
    """A database of one cycle: `avenue_east` is stable, `avenue_west` unknown."""
    url = f"sqlite:///{tmp_path / 'a.db'}"
    with open_database(url) as database:
        database.record_cycle(*_cycle(1))
    return url


@pytest.fixture
def net(tmp_path: Path) -> Path:
    """The demo's roads in Troy."""
    text = (resources.files("slipstream") / "data" / "demo.net.xml").read_text()
    x, y = TROY.offset_m
    path = tmp_path / "troy.net.xml"
    path.write_text(
        text.replace('projParameter="!"', f'projParameter="{TROY.parameter}"').replace(
            'netOffset="0.00,604.00"', f'netOffset="{x},{y}"'
        )
    )
    return path


@pytest.mark.slow
def test_a_run_is_judged_by_its_own_time(url: str, net: Path, tmp_path: Path) -> None:
    """States that were fresh in the cycle are not stale because it is long ago."""
    data, sites = tmp_path / "data.xml", tmp_path / "sites.xml"
    settings = tmp_path / "dispatcher.toml"
    settings.write_text(
        f'network = "{net}"\ndatabase_url = "{url}"\n[dispatcher.feeds]\n'
        'publisher = "Troy"\ncountry = "US"\n'
        '[rsus]\n"rsu/avenue_east" = { segments = ["avenue_east"] }\n'
        '"rsu/avenue_west" = { segments = ["avenue_west"] }\n'
    )
    options = ["--config", str(settings), "--out", str(data), "--sites", str(sites)]
    assert main(["feed", "datex2", *options]) == 0
    root = etree.parse(str(data)).getroot()
    assert [each.text for each in root.iter("{*}stability")] == ["stable", "unknown"]
    assert [each.text for each in root.iter("{*}country", "{*}nationalIdentifier")] == [
        "us",
        "Troy",
    ]
    (speed,) = root.iter("{*}speed")
    assert float(speed.text) == pytest.approx(3.6 * 15.2)
    assert len(list(etree.parse(str(sites)).iter(f"{ROA}measurementSite"))) == 2
    assert main(["feed", "datex2", *options]) == 2
    # A cycle that failed knew nothing: the one before tells.
    told = data.read_bytes()
    with open_database(url) as database:
        report, _, _ = _cycle(2)
        failed = {"status": "failed", "gates": (), "solvers": (), "energy": None, "plans": 0}
        database.record_cycle(report.model_copy(update=failed), [], [])
    assert main(["feed", "datex2", *options, "--force"]) == 0
    assert data.read_bytes() == told


def test_devices_of_a_run_have_the_status_that_their_states_tell(
    url: str, net: Path, tmp_path: Path
) -> None:
    """RSUs' health is not stored."""
    out = tmp_path / "wzdx.geojson"
    options = ["--database", url, "--network", str(net), "--out", str(out)]
    assert main(["feed", "wzdx", *options]) == 0
    features = json.loads(out.read_text())["features"]
    status = {f["id"]: f["properties"]["core_details"]["device_status"] for f in features}
    assert status == {
        "rsu%2Favenue_east/avenue_east": "ok",
        "rsu%2Favenue_west/avenue_west": "unknown",
    }


@pytest.mark.slow
def test_a_mistake_is_one_line(
    url: str, net: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Roads without latitude, no cycle, a table of sites for WZDx; nothing is written."""
    out = tmp_path / "feed"
    empty = f"sqlite:///{tmp_path / 'b.db'}"
    for options, line in (
        (["--database", url], "knows no latitude and longitude"),
        (["--database", empty, "--network", str(net)], "no cycle is stored there"),
        (["--database", url, "--network", str(net), "--out", str(out / "x")], "no such folder"),
        (["--database", url, "--sites", str(tmp_path / "s")], "WZDx has no table of sites"),
    ):
        assert main(["feed", "wzdx", "--out", str(out), *options]) == 2
        error = capsys.readouterr().err
        assert line in error
        assert error.count("\n") == 1
    assert not out.exists()
