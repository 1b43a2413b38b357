"""The units: what systemd makes of them, and whether they fit the daemons they start."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from edge_daemon.settings import EdgeSettings
from slipstream_cli.main import EXIT_BAD_INPUT, parser
from vehicle_agent.daemon import INTERVAL_S

from .conftest import DEPLOY

UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
DAEMONS = [unit for unit in UNITS if "router" not in unit.name]
_EXPOSURE_LIMIT = 1.5


def values(unit: Path, key: str) -> list[str]:
    """What a unit file assigns to a key, in order."""
    return re.findall(rf"^{key}=(.*)$", unit.read_text(), re.MULTILINE)


def seconds(text: str) -> float:
    """A systemd time span of one part."""
    number, unit = re.fullmatch(r"(\d+)(s|min)?", text).groups()  # type: ignore[union-attr]
    return float(number) * (60 if unit == "min" else 1)


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_has_nothing_to_say(unit: Path, tool: Callable[[str], str], tmp_path: Path) -> None:
    """`systemd-analyze verify` is silent, once the programs exist."""
    copy = tmp_path / unit.name.replace("@", "@x")
    text = unit.read_text()
    for program in {start.split()[0] for start in values(unit, "ExecStart")}:
        text = text.replace(program, "/bin/true")
    copy.write_text(text)
    done = subprocess.run(
        [tool("systemd-analyze"), "verify", "--man=no", str(copy)], capture_output=True, text=True
    )
    if "Failed to create" in done.stderr or "not permitted" in done.stderr:
        pytest.skip("systemd-analyze cannot work in this sandbox")
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_the_sandbox_is_tight(unit: Path, tool: Callable[[str], str]) -> None:
    """systemd's own measure of exposure, from 0 to 10, stays low."""
    done = subprocess.run(
        [tool("systemd-analyze"), "security", "--offline=true", "--no-pager", str(unit)],
        capture_output=True,
        text=True,
    )
    found = re.search(r"exposure level for \S+ ([\d.]+)", done.stdout)
    if found is None:
        pytest.skip(f"systemd-analyze cannot do it offline: {done.stderr.strip()[:80]}")
    assert float(found[1]) <= _EXPOSURE_LIMIT


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_fault_is_mended_and_bad_input_is_not_repeated(unit: Path) -> None:
    """Restarted on failure with a limit, but not after the exit status of bad input."""
    assert values(unit, "Type") == ["notify"]
    assert values(unit, "Restart") == ["on-failure"]
    assert values(unit, "RestartPreventExitStatus") == [str(EXIT_BAD_INPUT)]
    # A daemon that lives for a while before it dies must come back for ever.
    period = seconds(values(unit, "StartLimitIntervalSec")[0])
    assert period / int(values(unit, "StartLimitBurst")[0]) <= 30


@pytest.mark.parametrize("unit", DAEMONS, ids=lambda unit: unit.name)
def test_the_watchdog_is_slower_than_the_work(unit: Path) -> None:
    """Progress is told at least three times a watchdog period, whatever the settings."""
    slowest_beat = max(5.0, EdgeSettings.model_fields["state_interval_s"].metadata[-1].le)
    if "agent" in unit.name:
        slowest_beat = INTERVAL_S
    assert seconds(values(unit, "WatchdogSec")[0]) >= 3 * slowest_beat


@pytest.mark.parametrize("unit", DAEMONS, ids=lambda unit: unit.name)
def test_the_command_is_one_that_exists(unit: Path) -> None:
    """The daemon's arguments are understood by the command line."""
    (start,) = values(unit, "ExecStart")
    options = parser().parse_args(start.split()[1:])
    assert options.command in unit.name
    folder, name = str(options.config).split("/")
    assert folder == "${CREDENTIALS_DIRECTORY}"
    assert credentials(unit)[name] == f"/etc/slipstream/{name}"
    assert values(unit, "AssertPathExists") == [f"/etc/slipstream/{name}"]


def credentials(unit: Path) -> dict[str, str]:
    """Files that systemd hands a unit, by the name that they have for it."""
    return dict(value.split(":", 1) for value in values(unit, "LoadCredential"))


CLUSTER = {"tls/cluster-ca.pem", "tls/cluster.pem", "tls/cluster.key"}
HANDED = {
    "slipstream-agent@.service": {"bus/agent-%i", "site.toml"},
    "slipstream-dashboard.service": {"bus/dashboard", "site.toml"},
    "slipstream-dispatcher.service": {
        *("api-tokens.toml", "bus/dispatcher", "site.toml"),
        *CLUSTER,
    },
    "slipstream-edge@.service": {"bus/edge-%i", "site.toml"},
    "slipstream-router.service": {
        *("access.json", "bus/users", "router.json5", "tls/router.key"),
    },
    "slipstream-scheduler.service": {"site.toml", *CLUSTER},
    "slipstream-worker.service": {"site.toml", *CLUSTER},
}
"""The secrets below /etc/slipstream that each unit may have."""


@pytest.mark.attack
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_each_unit_gets_its_own_secrets_only(unit: Path) -> None:
    """The site's file, and no other daemon's key or password; none runs as another's user."""
    sources = {path.removeprefix("/etc/slipstream/") for path in credentials(unit).values()}
    assert sources == HANDED[unit.name]
    # Without a default, a machine of version 0.1 that has no such file would not start.
    defaults = {value.split(":")[0] for value in values(unit, "SetCredential")}
    assert defaults == {
        name
        for name, path in credentials(unit).items()
        if any(part in path for part in ("bus/", "tls/", "api-tokens", "access.json"))
    }
    # Instances of a template share a user, and so their secrets, unless they are told not to.
    if "@" in unit.name:
        daemon = unit.name.removeprefix("slipstream-").split("@")[0]
        assert values(unit, "User") == [f"{daemon}-%i"]
    assert values(unit, "DynamicUser") == ["yes"] or "dispatcher" in unit.name


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_refused_system_call_kills_no_daemon(unit: Path) -> None:
    """It ends with EPERM; processes that search may lower their priority."""
    assert values(unit, "SystemCallErrorNumber") == ["EPERM"]
    allowed = values(unit, "SystemCallFilter")
    searches = "dispatcher" in unit.name or "worker" in unit.name
    assert ("setpriority" in allowed[2:]) == searches


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_nothing_speaks_to_the_world(unit: Path) -> None:
    """All addresses are denied but loopback; an edge daemon also reaches private networks."""
    assert values(unit, "IPAddressDeny") == ["any"]
    (allowed,) = values(unit, "IPAddressAllow")
    assert (allowed == "localhost") == ("edge" not in unit.name)
    assert "0.0.0.0/0" not in allowed
