"""Runs a measuring process and watches the memory of it and of all that it starts."""

from __future__ import annotations

import json
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import psutil

_LOOK_EVERY_S: Final = 0.05


def watched(command: Sequence[str], log: Path, timeout_s: float) -> tuple[dict[str, Any], float]:
    """The JSON object that a process prints as its last line, and its peak memory in MB.

    Memory is the sum of resident memories over the tree of processes, twenty times a second; pages
    that processes share are counted in each.

    Raises:
        RuntimeError: it failed, took too long, or printed nothing; the log has what it said.
    """
    with log.open("a") as errors, tempfile.TemporaryFile("w+") as output:
        process = subprocess.Popen(command, stdout=output, stderr=errors)
        try:
            ends, peak = time.monotonic() + timeout_s, 0.0
            while process.poll() is None:
                peak = max(peak, tree_mb(process.pid))
                if time.monotonic() > ends:
                    raise RuntimeError(f"a run took more than {timeout_s:g} s; see {log}")
                time.sleep(_LOOK_EVERY_S)
        finally:
            _end(process.pid)
            process.wait()
        output.seek(0)
        printed = output.read()
        errors.write(printed)
    lines = printed.strip().splitlines()
    if process.returncode != 0 or not lines:
        raise RuntimeError(f"a run failed with status {process.returncode}; see {log}")
    values: dict[str, Any] = json.loads(lines[-1])
    return values, peak


def tree_mb(pid: int) -> float:
    """Resident memory of a process and its descendants as they are now, MB; 0 if it has ended."""
    total = 0
    for process in _tree(pid):
        try:
            total += process.memory_info().rss
        except psutil.NoSuchProcess:
            continue
    return total / 1e6


def _tree(pid: int) -> list[psutil.Process]:
    try:
        root = psutil.Process(pid)
        return [root, *root.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def _end(pid: int) -> None:
    """End what is left of the tree."""
    for process in _tree(pid):
        try:
            process.kill()
        except psutil.NoSuchProcess:
            continue
