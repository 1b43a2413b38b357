"""Meetings of vehicles: options and departures of each, blocks, sweeps over blocks."""

from __future__ import annotations

from dispatcher_daemon.planning.improvement.blocks import Block, build_block
from dispatcher_daemon.planning.improvement.carriers import nobody_worse_off
from dispatcher_daemon.planning.improvement.departures import longest_wait_s
from dispatcher_daemon.planning.improvement.exchanges import best_exchanges
from dispatcher_daemon.planning.improvement.options import add_discounted_ways, options_for
from dispatcher_daemon.planning.improvement.partition import blocks_of, opportunity_graph
from dispatcher_daemon.planning.improvement.refused import refused_platoons
from dispatcher_daemon.planning.improvement.sweeps import Choice, choice_of, scheduled

__all__ = [
    "Block",
    "Choice",
    "add_discounted_ways",
    "best_exchanges",
    "blocks_of",
    "build_block",
    "choice_of",
    "longest_wait_s",
    "nobody_worse_off",
    "opportunity_graph",
    "options_for",
    "refused_platoons",
    "scheduled",
]
