"""Users of the bus and the router's rules, made of a site's tables."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from slipstream.messages import (
    acknowledgement_key,
    advice_key,
    counts_key,
    plan_key,
    position_key,
    rsu_health_key,
    running_counts_key,
    sensing_key,
    state_key,
    stopped_key,
)
from slipstream_cli.place import bus_files
from slipstream_cli.place.bus_files import access_of, bus_users, main, prepare

CAMERA = {"camera": "camera.toml", "segments": ["a road/1"]}


def keys(tables: dict[str, object], rule: str) -> set[str]:
    """What a rule is about."""
    (found,) = (r for r in access_of(tables)["rules"] if r["id"] == rule)
    return set(found["key_exprs"])


def test_rules_have_the_keys_of_the_messages() -> None:
    """Names in them are percent-encoded as on the bus."""
    said = keys({"rsus": {"n.1 ü": CAMERA}}, "keys of n.1 ü")
    assert {
        rsu_health_key("n.1 ü"),
        state_key("n.1 ü", "a road/1"),
        stopped_key("n.1 ü", "a road/1"),
        counts_key("n.1 ü", "a road/1"),
        running_counts_key("n.1 ü", "a road/1"),
    } < said
    tables = {"agents": {"depot": {"vehicles": [{"id": "v/1"}]}}}
    assert {plan_key("v/1"), sensing_key("v/1")} < keys(tables, "heard by agent-depot")
    said = keys(tables, "keys of agent-depot")
    assert {position_key("v/1"), acknowledgement_key("v/1"), advice_key("v/1")} < said
    assert not any("*" in key.replace("@adv/**", "") for key in said if "/fleet/v" in key)


def test_who_runs_elsewhere_is_its_boxs() -> None:
    """One policy a box, with all that runs there; sensing and advice do not leave it."""
    here = {"segments": ["a"], "box": "box-1"}
    tables = {
        "dispatcher": {},
        "rsus": {"one": here, "two": here, "unknown": {"segments": ["b"]}},
        "agents": {"van": {"vehicles": [{"id": "v"}], "box": "van"}},
    }
    assert bus_users(tables) == ("dispatcher", "fleet", "signals", "box-1", "van")
    access = access_of(tables)
    assert {s["id"]: s["cert_common_names"] for s in access["subjects"]} == {
        "box-1": ["box-1"],
        "van": ["van"],
    }
    of_box, of_van = access["policies"]
    assert {"keys of one", "keys of two"} < set(of_box["rules"])
    assert sensing_key("v") not in keys(tables, "heard by agent-van")
    assert advice_key("v") not in keys(tables, "keys of agent-van")
    assert "asking for what agents hear" not in of_van["rules"]


def test_what_is_there_stays(tmp_path: Path) -> None:
    """Passwords by hand count, lines of others too; a second time nothing is left to do."""
    site = tmp_path / "site.toml"
    site.write_text('[rsus.north]\ncamera = "c.toml"\nsegments = ["a"]\n')
    (tmp_path / "bus").mkdir()
    (tmp_path / "bus" / "users").write_text("other:x:y\nedge-north:by hand")
    assert len(prepare(site, tmp_path)) == 2
    assert (tmp_path / "bus" / "users").read_text() == "other:x:y\nedge-north:by hand"
    assert (tmp_path / "bus" / "edge-north").read_text() == "by hand\n"
    assert prepare(site, tmp_path) == ()


@pytest.mark.parametrize(
    "text", ["[rsus", '[rsus."a:b".source]\nurl = "x"\n', '[rsus."a/b".source]\nurl = "x"\n']
)
def test_bad_input_is_one_line(
    tmp_path: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit status 2, and no file is made."""
    site = tmp_path / "site.toml"
    site.write_text(text)
    assert main([str(site), str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [*tmp_path.iterdir()] == [site]


@pytest.mark.process
def test_it_runs_where_nothing_is_installed(tmp_path: Path) -> None:
    """By Python alone, for the installer."""
    (tmp_path / "site.toml").write_text("[dispatcher]\n")
    command = [sys.executable, "-I", "-S", bus_files.__file__, str(tmp_path / "site.toml")]
    done = subprocess.run([*command, str(tmp_path)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "bus" / "dispatcher").exists()
