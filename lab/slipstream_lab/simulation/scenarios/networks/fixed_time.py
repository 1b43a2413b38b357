"""Fixed-time signals: the programs of a net with their nominal green times.

A net's actuated signals end their green when no vehicle comes, so their future greens are unknown.
With fixed times they are known in advance, as speed advice towards signals needs.
"""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

from slipstream_lab.simulation.sumo import elements, put_file

PROGRAM = "fixed"


def write_fixed_time(net: Path, path: Path) -> int:
    """Write an additional file that puts a net's signals on fixed times; an empty one where it has
    none, as on a motorway. Raises InputError: the net cannot be read.
    """
    lines = []
    for element in elements(net):
        if element.tag == "tlLogic":
            phases = "".join(
                f'<phase duration="{float(p.get("duration", 0.0)):g}" '
                f"state={quoteattr(p.get('state', ''))}/>"
                for p in element.iter("phase")
            )
            lines.append(
                f"    <tlLogic id={quoteattr(element.get('id', ''))} "
                f'type="static" programID="{PROGRAM}" offset="0">{phases}</tlLogic>\n'
            )
    put_file(path, f"<additional>\n{''.join(lines)}</additional>\n")
    return len(lines)
