"""SUMO's netconvert: where it is, how it is run, and a net stored byte for byte."""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Final

from slipstream.errors import InputError

OPTIONS: Final = (
    *("--tls.default-type", "actuated"),
    *("--tls.cycle.time", "80"),
    *("--tls.yellow.min-decel", "2"),
    *("--no-turnarounds.except-deadend", "true"),
    *("--output.street-names", "true"),
    *("--xml-validation", "never"),
)
_OWN: Final = re.compile(
    r"Environment variable SUMO_HOME|built in type maps|Discarding unknown comp"
)
"""Warnings about netconvert itself, or about what no car uses."""
_VARIES: Final = re.compile(r"'[^']*'|\"[^\"]*\"|-?\d+(?:\.\d+)?(?:#\d+)?")
"""What differs between warnings of one kind: names and numbers."""


def find_netconvert() -> Path | None:
    """Where netconvert is: under SUMO_HOME, beside this Python, or on the path; None if nowhere."""
    home = os.environ.get("SUMO_HOME")
    places = [*([Path(home) / "bin"] if home else []), Path(sys.executable).parent]
    beside = shutil.which("netconvert", path=os.pathsep.join(map(str, places)))
    found = beside or shutil.which("netconvert")
    return None if found is None else Path(found)


def convert(options: list[str], built: Path, source: str | Path) -> str:
    """Run netconvert.

    Args:
        source: what errors name.

    Returns:
        Its warnings.

    Raises:
        InputError: it is not installed, or refuses its input.
    """
    tool = find_netconvert()
    if tool is None:
        raise InputError(
            "netconvert",
            "not installed",
            "pip install eclipse-sumo, or set SUMO_HOME; the nets that ship need no building",
        )
    done = subprocess.run(
        [str(tool), *options, "--output-file", str(built)], capture_output=True, text=True
    )
    if done.returncode != 0 or not built.is_file():
        said = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        reason = said[0].removeprefix("Error: ") if said else f"exit status {done.returncode}"
        problem = f"netconvert refuses it: {reason}{first_warning(done.stderr)}"
        raise InputError(source, problem, "mend the network")
    return done.stderr


def warnings_of(said: str) -> dict[str, int]:
    """What netconvert warns of: how often each kind, by its first; the most frequent first."""
    kinds: Counter[str] = Counter()
    first: dict[str, str] = {}
    for line in said.splitlines():
        text = line.removeprefix("Warning: ")
        if text != line and not _OWN.search(text):
            kind = _VARIES.sub("…", text)
            first.setdefault(kind, text)
            kinds[kind] += 1
    return {first[kind]: count for kind, count in kinds.most_common()}


def first_warning(said: str) -> str:
    """What explains that netconvert made nothing of its input, in brackets; "": it says nothing."""
    return next((f" ({text.rstrip('.')})" for text in warnings_of(said)), "")


def keep(built: Path, path: Path) -> None:
    """Store a net without what changes from run to run: the comment with date and paths."""
    text = re.sub(r"<!--.*?-->\s*", "", built.read_text(encoding="utf-8"), flags=re.DOTALL)
    path.parent.mkdir(parents=True, exist_ok=True)
    data = text.encode("utf-8")
    path.write_bytes(gzip.compress(data, 9, mtime=0) if path.suffix == ".gz" else data)
