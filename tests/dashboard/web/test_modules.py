"""The page's scripts without a browser: their unit tests, and their types."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

pytestmark = [pytest.mark.process, pytest.mark.slow]
ROOT = Path(__file__).parents[3]
TESTS = sorted(Path(__file__).with_name("js").glob("*.test.js"))


def _run(*command: str) -> None:
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_modules_do_what_their_own_tests_say(tool: Callable[[str], str]) -> None:
    """With node's test runner, each file by its name: what a folder means differs by version."""
    assert len(TESTS) >= 5
    _run(tool("node"), "--test", *map(str, TESTS))


def test_types_agree(tool: Callable[[str], str]) -> None:
    """By `tsc --checkJs`, of this page and of `slipstream calibrate`'s (tsconfig.json)."""
    _run(tool("tsc"), "--project", str(ROOT))
