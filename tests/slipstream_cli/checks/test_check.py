"""`slipstream check` on the files of one site: all faults."""

from __future__ import annotations

import json
import math
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from slipstream.config import read_toml
from slipstream.roads.sumo_net import load_network
from slipstream_cli.main import main

Site = dict[str, Path]

TROY = str(resources.files("slipstream_lab.simulation.scenarios") / "data/troy/troy.net.xml.gz")


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


@pytest.mark.slow
def test_files_that_fit_are_valid(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """One line each, with what each is."""
    status, out, err = checked(capsys, site)
    assert (status, err) == (0, [])
    kinds = {
        line.split(": valid ")[0].rpartition("/")[2]: line.split(": valid ")[1] for line in out
    }
    assert kinds == {"camera-rsu-1.toml": "camera", "fleet.toml": "fleet", "site.toml": "site"}


@pytest.mark.slow
def test_a_kind_is_told_by_content_whatever_the_name(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names say nothing, or the wrong thing."""
    moved = site["site"].rename(site["site"].with_name("camera-9.toml"))
    assert main(["check", str(moved)]) == 0
    assert capsys.readouterr().out == f"{moved}: valid site\n"


@pytest.mark.slow
def test_a_segment_that_the_net_lacks_is_refused(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """The camera's file, the segment, and which network has not got it."""
    camera = read_toml(site["camera-rsu-1"])
    camera["segments"][0]["id"] = "nowhere"  # type: ignore[index]
    site["camera-rsu-1"].write_text(tomli_w.dumps(camera))
    status, _, err = checked(capsys, {"site": site["site"]})
    assert status == 2
    lacks = f"{site['camera-rsu-1']}: segments.nowhere: the network demo has no such segment"
    assert any(lacks in line for line in err)
    assert any("does not list it for 'rsu-1'" in line for line in err)
    alone = site["camera-rsu-1"].rename(site["site"].parents[1] / "camera.toml")
    assert checked(capsys, {"camera": alone})[0] == 0
    assert checked(capsys, {"camera": alone}, "--network", "demo")[0] == 2


@pytest.mark.slow
def test_faults_of_a_site_are_all_told(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """Ports taken twice, a segment that no network has, agents too many, a misspelt key."""
    tables: Any = read_toml(site["site"])
    tables["rsus"]["rsu-2"] = {"segments": ["nowhere"]}
    tables["dashboard"] |= {"port": 9465, "scene_port": 9467, "time_zon": "x", "network": "x"}
    tables["dispatcher"]["interval_s"] = "30"
    tables["agents"]["vans"]["vehicles"] = [{"id": "van-1"}]
    tables["agents"]["more"] = {"vehicles": [{"id": "van-1"}], "stat": "x"}
    change(site["site"], **tables)
    status, out, err = checked(capsys, {"site": site["site"]})
    assert (status, out) == (2, [])
    for said in (
        "dashboard.port: port 9465 is taken by dispatcher.metrics_port",
        "dashboard.scene_port: port 9467 is taken by agents.vans.metrics_port",
        "dashboard.time_zon: unknown key; did you mean time_zone?",
        "dashboard.network: stands once, at the top of the file; move it there",
        "dispatcher.interval_s: ",
        "rsus.rsu-2: the network has no segment nowhere",
        "agents.more.stat: unknown key; did you mean state?",
    ):
        assert sum(f"{site['site']}: {said}" in line for line in err) == 1, (said, err)
    assert len(err) == 7


@pytest.mark.slow
def test_vehicles_have_one_agent_and_a_place_in_the_fleet(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two processes for one vehicle, and one for nobody's."""
    tables: Any = read_toml(site["site"])
    tables["agents"]["more"] = {"vehicles": [{"id": "van-1"}, {"id": "van-9"}]}
    change(site["site"], **tables)
    _, _, err = checked(capsys, {"site": site["site"]})
    twice, nobody = err
    assert "agents.more.vehicles.van-1: agents.vans has an agent of it too" in twice
    assert "agents.more.vehicles.van-9: the fleet has no such vehicle" in nobody


@pytest.mark.slow
def test_boxes_that_share_no_machine_may_have_the_same_ports(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a router over the network each daemon may have its ports to itself."""
    tables: Any = read_toml(site["site"])
    tables["dashboard"]["port"] = 9465
    change(site["site"], **tables)
    assert checked(capsys, {"site": site["site"]})[0] == 2
    change(site["site"], bus={"connect": ["tcp/10.0.0.1:7447"]})
    assert checked(capsys, {"site": site["site"]})[0] == 0


@pytest.mark.slow
def test_an_rsu_whose_segments_are_not_said_is_told(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    """The dispatcher would not know what to admit of it; the unit itself needs none."""
    tables: Any = read_toml(site["site"])
    del tables["rsus"]["rsu-1"]["segments"]
    change(site["site"], **tables)
    _, _, (err, *_) = checked(capsys, {"site": site["site"]})
    assert "rsus.rsu-1.segments: missing key; add it" in err
    for table in ("dispatcher", "dashboard"):
        del tables[table]
    site["site"].write_text(tomli_w.dumps(tables))
    assert checked(capsys, {"site": site["site"]})[0] == 0


@pytest.mark.slow
def test_a_fault_is_told_once_whatever_the_path(
    site: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The site names the fleet by its absolute path, the command by a relative one."""
    fleet = read_toml(site["fleet"])
    fleet["depots"] = [{"id": "depot", "node": "mars"}, {"id": "second", "node": "venus"}]
    site["fleet"].write_text(tomli_w.dumps(fleet))
    monkeypatch.chdir(site["fleet"].parent)
    status, _, err = checked(capsys, {stem: Path(path.name) for stem, path in site.items()})
    assert status == 2
    assert sum("unknown node 'mars'" in line for line in err) == 1
    assert sum("unknown node 'venus'" in line for line in err) == 1


@pytest.mark.slow
def test_json_has_files_and_faults(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    """One object, exit status 2 as without."""
    change(site["site"], network="other.net.xml")
    status, out, err = checked(capsys, {"site": site["site"]}, "--json")
    answer = json.loads("\n".join(out))
    assert (status, err, answer["valid"]) == (2, [], [])
    (gone,) = answer["faults"]
    assert gone.keys() == {"file", "key", "problem", "mend"}
    assert "other.net.xml" in gone["file"]


@pytest.mark.slow
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


@pytest.mark.slow
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
    assert (said.err, len(said.out.splitlines())) == ("", 4)
    assert f"{tokens}: valid file of tokens" in said.out
    tokens.write_text('[[tokens]]\nname = "ada"\nsha256 = "short"\nscopes = ["read"]\n')
    assert main(["check", str(folder)]) == 2
    assert f"{tokens}: tokens.0.sha256" in capsys.readouterr().err
    assert main(["check", str(folder / "nothing")]) == 2


@pytest.mark.slow
def test_a_fleet_alone_is_judged_by_the_roads_of_its_settings(
    site: Site, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Those of the site.toml beside it; where there is none, it says what is unchecked."""
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
