"""What each daemon can read, in the units and with the permissions that are shipped."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import ROOT

BOOT = Path(__file__).with_name("boot.sh")
READS = {
    "slipstream-router": (
        "slipstream-router",
        {"access.json", "bus-users", "router.json5", "router.key"},
    ),
    "slipstream-dispatcher": (
        "slipstream",
        {
            *("api-tokens", "bus-password", "site.toml"),
            *("cluster-ca.pem", "cluster.pem", "cluster.key"),
        },
    ),
    "slipstream-dashboard": ("slipstream-dashboard", {"bus-password", "site.toml"}),
    "slipstream-agent@depot-1": ("agent-depot-1", {"bus-password", "site.toml"}),
    "slipstream-edge@rsu-1": ("edge-rsu-1", {"bus-password", "site.toml"}),
    "slipstream-edge@north": ("edge-north", {"bus-password", "site.toml"}),
}
"""The user and the secrets of each unit."""


@pytest.mark.attack
@pytest.mark.long
@pytest.mark.process
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can boot systemd")
def test_each_daemon_reads_its_own_secrets_only(
    tmp_path: Path, tool: Callable[[str], str], figure: Callable[[str], None]
) -> None:
    """A probe in each unit's place, in a booted systemd: no other's file, by path or by /proc."""
    namespaces = [
        "--mount",
        "--pid",
        "--fork",
        "--cgroup",
        "--uts",
        "--ipc",
        "--propagation",
        "private",
    ]
    script = ("bash", str(BOOT), str(ROOT), str(tmp_path))
    tool("systemd-analyze")
    booted = subprocess.run(
        [tool("unshare"), *namespaces, *script], capture_output=True, text=True, timeout=800
    )
    if not (tmp_path / "log").exists():
        pytest.skip(f"systemd cannot be booted here: {booted.stderr.strip()[-200:]}")
    log = (tmp_path / "log").read_text()
    read = 0
    for unit, (user, secrets) in READS.items():
        *files, name, end = (tmp_path / unit).read_text().splitlines()
        assert (name, end) == (user, "end"), log
        own = {f"/run/credentials/{unit}.service/{secret}" for secret in secrets}
        through_proc = {re.sub(r"^/proc/\d+/root", "", file) for file in files}
        # A calibration is no secret, and read by its path; agents read nothing there.
        calibration = set() if "agent" in unit else {"/etc/slipstream/camera-rsu-1.toml"}
        assert through_proc == own | calibration, unit
        read += len(own)
    figure(f"{len(READS)} daemons read {read} secrets, each its own")
