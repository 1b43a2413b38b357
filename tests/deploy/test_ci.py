"""CI runs what elsewhere may be skipped for want of a tool."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable

import pytest

from .conftest import ROOT

RUN = ROOT / ".ci" / "run"


def required() -> set[str]:
    """The tools that CI requires."""
    found = re.search(r'^export CI_REQUIRES="([^"]+)"$', RUN.read_text(), re.MULTILINE)
    assert found is not None
    return set(found[1].split())


def test_ci_requires_every_tool_that_a_test_may_be_skipped_for() -> None:
    """Each tool that a test asks for by name is installed by CI; all Linux has `unshare`, and `tsc`
    is required where it could be installed.
    """
    asked = {
        name
        for path in (ROOT / "tests").rglob("*.py")
        for name in re.findall(r'\btool\("([^"]+)"\)', path.read_text())
    }
    assert "nginx" in asked
    assert asked - {"tsc", "unshare"} <= required()


@pytest.mark.attack
def test_a_missing_tool_fails_where_ci_requires_it(
    tool: Callable[[str], str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Skipped on a machine of one's own, failed in CI."""
    monkeypatch.setattr("shutil.which", lambda *_, **__: None)
    monkeypatch.setenv("CI_REQUIRES", "chromium shellcheck")
    with pytest.raises(pytest.fail.Exception, match="shellcheck is not installed"):
        tool("shellcheck")
    with pytest.raises(pytest.skip.Exception):
        tool("nginx")


def test_shellcheck_has_nothing_to_say_of_ci(tool: Callable[[str], str]) -> None:
    """The script is clean."""
    done = subprocess.run([tool("shellcheck"), str(RUN)], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "")
