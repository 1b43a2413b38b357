"""A request in VROOM's format, as the worker process answers it."""

from __future__ import annotations

import json
from dataclasses import dataclass

from dispatcher_daemon.api.solving.worker import traffic_on
from dispatcher_daemon.fleet_watch import Learned
from dispatcher_daemon.settings import DispatcherSettings
from dispatcher_daemon.vroom import RoutingEngine, solve_vroom
from slipstream.messages import SegmentState


@dataclass(frozen=True)
class VroomTask:
    """What a worker needs; it can be pickled. Fields not described here are as in `SolveTask`.

    Attributes:
        request: plain data, as JSON gives it.
        deadline_s: for the whole answer.
        geometry: see `solve_vroom`.
        choose_eta: likewise.
    """

    request: object
    deadline_s: float
    geometry: bool
    choose_eta: bool
    settings: DispatcherSettings
    roads: str
    states: tuple[SegmentState, ...]
    learned: Learned
    now_ns: int
    seed: int

    def run(self) -> bytes:
        """The answer in VROOM's format, as JSON, by travel times of the task's moment.

        Raises:
            InputError: the network's file has changed since the dispatcher read it.
        """
        engine = RoutingEngine(
            *traffic_on(self.settings, self.roads, self.states, self.learned, self.now_ns)
        )
        answer = solve_vroom(
            self.request,
            engine,
            self.deadline_s,
            self.seed,
            geometry=self.geometry,
            choose_eta=self.choose_eta,
            source="body",
        )
        return json.dumps(answer, ensure_ascii=False).encode()
