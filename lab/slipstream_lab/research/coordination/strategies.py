"""All strategies by name, the rivals' and our own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from slipstream_lab.research.coordination.case import CoordinationCase
from slipstream_lab.research.coordination.local_search import local_search
from slipstream_lab.research.coordination.pairwise import pairwise_leaders
from slipstream_lab.research.coordination.plan import Plan, Strategy, undelayed
from slipstream_lab.research.coordination.schedule import Worth, answer_in_turn
from slipstream_lab.research.coordination.threshold import best_threshold

_MAX_ROUNDS: Final = 50


def hub_waiting(case: CoordinationCase) -> Plan:
    """Each trip waits at hubs as is best for itself, given everybody's present schedule, in turn,
    until nobody changes.

    A. Johansson, E. Nekouei, K. H. Johansson, J. Mårtensson: Strategic hub-based platoon
    coordination under uncertain travel times, IEEE T-ITS 23 (2022; first online 2021), for the game
    and its equilibria by answers in turn; T. Bai, A. Johansson, K. H. Johansson, J. Mårtensson:
    Large-scale multi-fleet platoon coordination: a dynamic programming approach, IEEE T-ITS 24
    (2023), for the dynamic program. A platoon's saving is shared equally among its members.
    """
    return answer_in_turn(case, undelayed(case), Worth.equally_shared(), _MAX_ROUNDS)


STRATEGIES: Final[Mapping[str, Strategy]] = MappingProxyType(
    {
        "as ready": undelayed,
        "threshold": best_threshold,
        "pairwise leaders": pairwise_leaders,
        "hub waiting": hub_waiting,
        "local search": local_search,
    }
)
"""Each a function from a case to a plan. A further one is a further entry."""
