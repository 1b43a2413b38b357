"""What an installation has to contain."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest

from .conftest import ROOT

_IMPORTED = """
import sys
before = set(sys.modules)  # what the environment itself starts with
from slipstream_cli.main import main
import vehicle_agent.daemon
assert main(["check", sys.argv[1]]) == 0
print(*{n.split(".")[0] for n, m in sys.modules.items() if m and n not in before})
"""


def names(requirements: list[str]) -> set[str]:
    """Distributions, without versions and what only an extra needs."""
    found = {re.match(r"[\w.-]+", line) for line in requirements if "extra ==" not in line}
    return {match[0].lower().replace("_", "-") for match in found if match is not None}


@pytest.mark.slow
def test_agents_need_the_base_installation_only(etc: Path) -> None:
    """No extra's package, and of the base neither numpy nor sumolib: a vehicle's box has no map."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    base = names(project["dependencies"])
    assert {"numpy", "sumolib"} < base
    done = subprocess.run(
        [sys.executable, "-c", _IMPORTED, str(etc / "site-agent.toml")],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        timeout=60,
    )
    modules = set(done.stdout.splitlines()[-1].split())
    used = {
        owner.lower().replace("_", "-")
        for module, owners in packages_distributions().items()
        for owner in owners
        if module in modules and owner != project["name"]
    }
    assert "eclipse-zenoh" in used
    needed = base - {"numpy", "sumolib"}
    for name in sorted(needed):
        needed |= names(requires(name) or [])
    assert used <= needed
