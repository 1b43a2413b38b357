"""What an installation has to contain."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions, requires
from pathlib import Path

import pytest

from slipstream import __version__

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


ROLES = {
    "agent": set(),
    "edge": {"edge"},
    "server": {"dispatcher", "dashboard", "cluster"},
    "worker": {"dispatcher", "cluster"},
    "all": {"edge", "dispatcher", "dashboard", "cluster"},
}
"""By role the extras of its daemons."""
PINNED = re.compile(r"^([\w.-]+)==(\S+)(?: ;[^\\\n]*)? \\\n +--hash=sha256:", re.MULTILINE)


def pinned(lock: Path) -> dict[str, set[str]]:
    """The versions of each library of a lock; several, where Pythons differ."""
    found: dict[str, set[str]] = {}
    for name, version in PINNED.findall(lock.read_text()):
        found.setdefault(name, set()).add(version)
    return found


@pytest.mark.parametrize("role", ROLES)
def test_a_role_s_lock_has_what_its_daemons_ask_for(role: str) -> None:
    """Each with hashes, from no named index, the same in every lock that has it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lock = ROOT / "deploy" / "locks" / f"{role}.txt"
    text = lock.read_text()
    assert "://" not in text
    assert len(PINNED.findall(text)) == len(re.findall(r"^\S+==", text, re.MULTILINE))
    asked = names(project["dependencies"])
    for extra in ROLES[role]:
        asked |= names(project["optional-dependencies"][extra])
    libraries = pinned(lock)
    assert asked <= libraries.keys()
    others = [*lock.parent.glob("*.txt"), *(lock.parent / "extras").glob("*.txt")]
    assert len(others) > len(ROLES)
    for other in map(pinned, others):
        for name in libraries.keys() & other.keys():
            assert libraries[name] == other[name]


def test_the_laboratory_asks_for_the_product_of_its_version() -> None:
    """The version stands in the product, and once more where the laboratory asks for it."""
    project = tomllib.loads((ROOT / "lab" / "pyproject.toml").read_text())["project"]
    assert f"slipstream[edge,dispatcher,dashboard]=={__version__}" in project["dependencies"]
