"""From a plan to a SUMO net, byte for byte."""

from __future__ import annotations

import tempfile
from pathlib import Path

from slipstream.osm.netconvert import OPTIONS, convert, keep
from slipstream_lab.simulation.scenarios.networks.plan import NetworkPlan, write_plain


def build_net(plan: NetworkPlan, path: Path) -> None:
    """Build the net of a plan; the same plan and the same netconvert give the same bytes.

    Args:
        path: of the net; compressed if it ends in ``.gz``.

    Raises:
        InputError: netconvert is not installed, or refuses the plan.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        options = [*write_plain(plan, folder), *OPTIONS]
        if plan.geographic:
            options += ["--proj.utm", "true"]
        convert(options, folder / "built.net.xml", plan.name)
        keep(folder / "built.net.xml", path)
