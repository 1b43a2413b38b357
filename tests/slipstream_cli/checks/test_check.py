"""`slipstream check` on the files of one site: all faults, also those between files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import tomli_w

import slipstream_lab.simulation
from slipstream.config import read_toml
from slipstream.sumo_net import load_network
from slipstream_cli.main import main

Site = dict[str, Path]

TROY = str(Path(slipstream_lab.simulation.__file__).parent / "scenarios/data/troy/troy.net.xml.gz")


@pytest.fixture
def site(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Site:
    """Files that fit each other, by their stem."""
    assert main(["init", str(tmp_path / "site")]) == 0
    capsys.readouterr()
    return {path.stem: path for path in (tmp_path / "site").glob("*.toml")}


def change(path: Path, **values: Any) -> None:
    """Set keys at the top of a file."""
    path.write_text(tomli_w.dumps(read_toml(path) | values))


def checked(
    capsys: pytest.CaptureFixture[str], site: Site, *more: str
) -> tuple[int, list[str], list[str]]:
    """(exit status, lines of the valid files, lines of faults)."""
    status = main(["check", *map(str, sorted(site.values())), *more])
    said = capsys.readouterr()
    return status, said.out.splitlines(), said.err.splitlines()


def test_files_that_fit_are_valid(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """One line each, with what each is."""
    status, out, err = checked(capsys, site)
    assert (status, err) == (0, [])
    kinds = {
        line.split(": valid ")[0].rpartition("/")[2]: line.split(": valid ")[1] for line in out
    }
    assert kinds == {
        "agents.toml": "agent settings",
        "camera-rsu-1.toml": "camera",
        "dashboard.toml": "dashboard settings",
        "dispatcher.toml": "dispatcher settings",
        "edge-rsu-1.toml": "edge settings",
        "fleet.toml": "fleet",
    }


def test_a_kind_is_told_by_content_whatever_the_name(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names say nothing, or the wrong thing; a key that no other daemon has decides."""
    change(site["dispatcher"], interval_s=30.0)
    moved = {
        stem: path.rename(path.with_name(f"dashboard-{number}.toml"))
        for number, (stem, path) in enumerate(sorted(site.items()))
        if stem in ("agents", "dispatcher")
    }
    status, out, _ = checked(capsys, {**site, **moved})
    assert status == 0
    assert f"{moved['dispatcher']}: valid dispatcher settings" in out
    assert f"{moved['agents']}: valid agent settings" in out


def test_a_segment_that_the_net_lacks_is_refused(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """The camera's file, the segment, and whose network it is."""
    camera = read_toml(site["camera-rsu-1"])
    camera["segments"][0]["id"] = "nowhere"  # type: ignore[index]
    site["camera-rsu-1"].write_text(tomli_w.dumps(camera))
    status, _, err = checked(capsys, site)
    assert status == 2
    lacks = f"{site['camera-rsu-1']}: segments.nowhere: the network of {site['dispatcher']} has no"
    assert any(lacks in line for line in err)
    only_camera = {"camera": site["camera-rsu-1"]}
    assert checked(capsys, only_camera)[0] == 0
    assert checked(capsys, only_camera, "--network", "demo")[0] == 2


def test_faults_between_files_are_all_told(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """RSU names twice, ports taken twice, roads that are watched by others, an agent too many."""
    second = site["edge-rsu-1"].with_name("edge-rsu-2.toml")
    second.write_text(site["edge-rsu-1"].read_text())
    other = site["fleet"].with_name("other.txt")
    other.write_text(site["fleet"].read_text())
    rsus = {"rsu-1": ["avenue_east"]}
    change(site["dashboard"], port=9465, scene_port=9467, rsus=rsus, fleet=str(other))
    change(site["agents"], vehicles=[{"id": "van-1"}, {"id": "van-9"}])
    status, out, err = checked(capsys, {**site, "edge-rsu-2": second})
    assert status == 2
    assert len(out) == 7
    assert all(line.startswith("slipstream: ") for line in err)
    for said in (
        f"{second}: rsu: 'rsu-1' is also the name in {site['edge-rsu-1']}",
        f"{second}: service.metrics_port: port 9464 is taken by service.metrics_port",
        f"{site['dispatcher']}: service.metrics_port: port 9465 is taken by port of",
        f"{site['dashboard']}: scene_port: port 9467 is taken by service.metrics_port of",
        f"{site['dashboard']}: rsus: not the same as in {site['dispatcher']}",
        f"{site['dashboard']}: fleet: not the same as in {site['dispatcher']}",
        f"{site['agents']}: vehicles.van-9: no fleet file has this vehicle",
    ):
        assert any(said in line for line in err), said
    assert len(err) == 7


def test_a_port_that_one_file_asks_for_twice_names_its_keys(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both of them, not the file itself as another one."""
    change(site["dashboard"], scene_port=9555, service={"metrics_port": 9555})
    _, _, err = checked(capsys, site)
    (told,) = [line for line in err if "9555" in line]
    assert "service.metrics_port: port 9555 is taken by scene_port;" in told


def test_boxes_that_share_no_machine_may_have_the_same_ports(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two edge boxes reach the router over the network: each has its ports to itself."""
    second = site["edge-rsu-1"].with_name("edge-rsu-2.toml")
    second.write_text(site["edge-rsu-1"].read_text())
    for path in (site["edge-rsu-1"], second):
        change(path, bus={"connect": ["tcp/10.0.0.1:7447"]})
    change(second, rsu="rsu-2")
    _, _, err = checked(capsys, {**site, "edge-rsu-2": second})
    assert not any("is taken by" in line for line in err)


def test_an_rsu_that_the_dispatcher_does_not_admit_is_told(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its name, or the segment that it may not speak of."""
    for path in (site["dispatcher"], site["dashboard"]):
        change(path, rsus={"rsu-1": ["avenue_east"]})
    _, _, err = checked(capsys, site)
    assert any("does not list it for 'rsu-1'" in line for line in err)
    for path in (site["dispatcher"], site["dashboard"]):
        change(path, rsus={"rsu-7": ["avenue_east"]})
    _, _, err = checked(capsys, site)
    assert any(f"{site['edge-rsu-1']}: rsu: " in line for line in err)


def test_all_faults_of_one_file_are_told_once(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Depots off the net and a misspelt key, though two files name the fleet."""
    fleet = read_toml(site["fleet"])
    fleet["depots"] = [{"id": "depot", "node": "mars"}, {"id": "second", "node": "venus"}]
    site["fleet"].write_text(tomli_w.dumps(fleet))
    change(site["agents"], stale_afer_s=4.0, state=3)
    status, _, err = checked(capsys, site)
    assert status == 2
    assert sum("unknown node 'mars'" in line for line in err) == 1
    assert sum("unknown node 'venus'" in line for line in err) == 1
    assert any("stale_afer_s: unknown key; did you mean stale_after_s?" in line for line in err)
    assert any(": state: " in line for line in err)


def test_a_fault_is_told_once_whatever_the_path(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The settings name the fleet by its absolute path, the command by a relative one."""
    fleet = read_toml(site["fleet"])
    fleet["depots"] = [{"id": "depot", "node": "mars"}]
    site["fleet"].write_text(tomli_w.dumps(fleet))
    monkeypatch.chdir(site["fleet"].parent)
    status, _, err = checked(capsys, {stem: Path(path.name) for stem, path in site.items()})
    assert status == 2
    assert sum("unknown node 'mars'" in line for line in err) == 1


def test_faults_within_files_hide_none_between_them(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """A fleet and a dashboard that are not valid: what can be read of them is compared."""
    fleet = read_toml(site["fleet"])
    fleet["depots"] = [{"id": "depot", "node": "mars"}]
    site["fleet"].write_text(tomli_w.dumps(fleet))
    camera = read_toml(site["camera-rsu-1"])
    camera["segments"][0]["id"] = "nowhere"  # type: ignore[index]
    site["camera-rsu-1"].write_text(tomli_w.dumps(camera))
    change(site["dashboard"], port=9465, scene_port="9467", database_url="sqlite:///other.db")
    change(site["agents"], vehicles=[{"id": "van-9"}])
    status, _, err = checked(capsys, site)
    assert status == 2
    for said in (
        "unknown node 'mars'",
        f"{site['dashboard']}: scene_port: ",
        f"{site['camera-rsu-1']}: segments.nowhere: the network of {site['dispatcher']} has no",
        f"{site['dispatcher']}: service.metrics_port: port 9465 is taken by port of",
        f"{site['dashboard']}: database_url: not the same as in {site['dispatcher']}",
        f"{site['agents']}: vehicles.van-9: no fleet file has this vehicle",
    ):
        assert sum(said in line for line in err) == 1, said


def test_keys_that_cannot_be_read_are_not_compared(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """The one fault of each file is all that is told: defaults do not stand for such keys."""
    change(site["dashboard"], network=3, rsus=4)
    change(site["edge-rsu-1"], camera=5)
    change(site["fleet"], vehicles=[{"id": 7}])
    status, _, err = checked(capsys, site)
    assert status == 2
    assert not any("not the same" in line or "no fleet file" in line for line in err)
    for stem, key in (("dashboard", "network"), ("dashboard", "rsus"), ("edge-rsu-1", "camera")):
        assert any(line.startswith(f"slipstream: {site[stem]}: {key}: ") for line in err)


def test_a_fleet_that_the_dashboard_lacks_is_told(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """It would not start."""
    change(site["dashboard"], fleet="gone.toml")
    status, _, err = checked(capsys, site)
    assert status == 2
    gone, other = err
    assert "gone.toml: no such file" in gone
    assert f"{site['dashboard']}: fleet: not the same as in {site['dispatcher']}" in other


def test_json_has_files_and_faults(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """One object, exit status 2 as without."""
    change(site["dashboard"], network="other.net.xml")
    status, out, err = checked(capsys, site, "--json")
    answer = json.loads("\n".join(out))
    assert (status, err) == (2, [])
    assert {Path(row["file"]).stem for row in answer["valid"]} == set(site) - {"dashboard"}
    gone, other = answer["faults"]
    assert gone.keys() == other.keys() == {"file", "key", "problem", "mend"}
    assert "other.net.xml" in gone["file"]
    assert (other["file"], other["key"]) == (str(site["dashboard"]), "network")


def test_how_far_off_each_place_is_served_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """To the junction, beside the distance to the road; of depots too where there is no stop; of a
    place whose junction the file names, to that one; in JSON as well.
    """
    network = load_network(TROY)
    assert network.projection is not None
    road = max(network.segments.values(), key=lambda s: s.length_m)
    (x0, y0), (x1, y1) = road.shape[:2]
    ((lat, lon),) = network.projection.degrees([(0.6 * x0 + 0.4 * x1, 0.6 * y0 + 0.4 * y1)])
    depots: list[dict[str, Any]] = [
        {"id": "near", "lat": lat, "lon": lon},
        {"id": "named", "lat": lat, "lon": lon, "node": "hoosick_15th"},
    ]
    fleet = tmp_path / "fleet.toml"
    vehicles = [{"id": "v", "depot": "near"}]
    fleet.write_text(tomli_w.dumps({"depots": depots, "vehicles": vehicles}))
    assert main(["check", str(fleet), "--network", TROY]) == 0
    near, named, valid = capsys.readouterr().out.splitlines()
    place = network.projection.place_m(lat, lon)
    away_m = min(math.dist(place, network.junctions[end]) for end in (road.start, road.end))
    assert f"depots.near: served {away_m:.0f} m away, at " in near
    assert ", 0 m from the place" in near
    far_m = math.dist(place, network.junctions["hoosick_15th"])
    assert named.endswith(f"depots.named: served {far_m:.0f} m away, at hoosick_15th, by the file")
    assert valid.endswith("valid fleet")
    assert main(["check", str(fleet), "--network", TROY, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["valid"][0]["notes"] == [near, named]


def test_a_folder_is_checked_with_the_file_of_tokens_in_it(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """As /etc/slipstream is; a faulty token is named."""
    folder = site["fleet"].parent
    tokens = folder / "api-tokens.toml"
    assert main(["token", "new", "ada", "--scopes", "read", "--file", str(tokens)]) == 0
    capsys.readouterr()
    assert main(["check", str(folder)]) == 0
    said = capsys.readouterr()
    assert (said.err, len(said.out.splitlines())) == ("", 7)
    assert f"{tokens}: valid file of tokens" in said.out
    tokens.write_text('[[tokens]]\nname = "ada"\nsha256 = "short"\nscopes = ["read"]\n')
    assert main(["check", str(folder)]) == 2
    assert f"{tokens}: tokens.0.sha256" in capsys.readouterr().err
    assert main(["check", str(folder / "nothing")]) == 2


def test_a_fleet_alone_is_judged_by_the_roads_of_its_settings(
    site: Site, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Those of the dispatcher's file beside it; where none names it, it says what is unchecked."""
    fleet = site["fleet"]
    table = read_toml(fleet)
    table["stops"][0]["node"] = "elsewhere"  # type: ignore[index]
    fleet.write_text(tomli_w.dumps(table))
    assert main(["check", str(fleet)]) == 2
    assert "unknown node 'elsewhere'" in capsys.readouterr().err
    alone = tmp_path / "fleet.toml"
    alone.write_text(fleet.read_text())
    assert main(["check", str(alone)]) == 0
    assert f"{alone}: its roads are not known" in capsys.readouterr().out
    assert main(["check", str(alone), "--network", "demo"]) == 2
    table["vehicles"][0]["depot"] = "nowhere"  # type: ignore[index]
    alone.write_text(tomli_w.dumps(table))
    assert main(["check", str(alone)]) == 2


def test_two_prices_of_a_kilowatt_hour_are_told(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page would count savings at another price than routes are weighed by."""
    change(site["dispatcher"], prices={"energy_kwh": 0.35})
    status, _, err = checked(capsys, site)
    assert status == 2
    assert err == [
        f"slipstream: {site['dashboard']}: price_per_kwh: 0.35 in {site['dispatcher']}, "
        "where it is prices.energy_kwh; give both the same"
    ]
