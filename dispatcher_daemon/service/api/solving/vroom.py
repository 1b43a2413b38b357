"""A request in VROOM's format, as the worker process answers it."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from dispatcher_daemon.service.api.solving.worker import RoadTask
from dispatcher_daemon.service.vroom import RoutingEngine, solve_vroom

_MARGIN_S: Final = 0.5
"""Of the time left, for the way of the answer, s."""


@dataclass(frozen=True)
class VroomTask(RoadTask):
    """A request to answer.

    Attributes:
        request: plain data, as JSON gives it.
        answer_by_ns: UTC; its caller waits no longer.
    """

    request: object
    deadline_s: float
    answer_by_ns: int
    geometry: bool
    choose_eta: bool

    def __call__(self) -> bytes:
        """The answer in VROOM's format, as JSON, by travel times of the task's moment.

        Raises:
            InputError: the network's file has changed since the dispatcher read it.
        """
        engine, given = None, self.request if isinstance(self.request, Mapping) else {}
        if not given.get("matrices") and given.get("matrix") is None:
            engine = RoutingEngine(*self.traffic())
        left_s = 1e-9 * (self.answer_by_ns - time.time_ns()) - _MARGIN_S
        answer = solve_vroom(
            self.request,
            engine,
            max(0.1, min(self.deadline_s, left_s)),
            self.seed,
            geometry=self.geometry,
            choose_eta=self.choose_eta,
            source="body",
        )
        return json.dumps(answer, ensure_ascii=False).encode("utf-8", "replace")
