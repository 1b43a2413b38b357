"""`slipstream solve --vroom`: a request in VROOM's format, answered in VROOM's format."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from slipstream.config import read_json
from slipstream.errors import InputError
from slipstream.service.logs import complain

if TYPE_CHECKING:
    from dispatcher_daemon.service.vroom import RoutingEngine

ONLY_FOR_IT = ("network", "out", "geometry", "choose_eta")
_NOT_FOR_IT = ("instance", "model", "solver", "form", "write")


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the options of requests in VROOM's format."""
    group = command.add_argument_group("requests in VROOM's format")
    group.add_argument("--vroom", type=Path, metavar="FILE", help="a request as JSON")
    group.add_argument(
        "--network",
        metavar="NET",
        help="a SUMO net that coordinates are on; without it a request needs matrices",
    )
    group.add_argument("--out", type=Path, metavar="FILE", help="the answer (default: printed)")
    group.add_argument(
        "--geometry", action="store_true", help="add each route's way as an encoded polyline"
    )
    group.add_argument(
        "--choose-eta",
        action="store_true",
        help="VROOM's plan mode: choose times for the routes in the vehicles' steps",
    )


def answer(options: argparse.Namespace) -> int:
    """Answer the request; the exit status is 2 for bad input and 1 for an internal error."""
    from dispatcher_daemon.service.vroom import INTERNAL_ERROR, solve_vroom

    for name in _NOT_FOR_IT:
        if getattr(options, name):
            raise InputError(f"--{name}", "not for --vroom", "leave one of them out")
    if options.objective == "paper":
        mend = "take energy, or leave it out for the request's own costs"
        raise InputError("--objective paper", "not for --vroom", mend)
    request = read_json(options.vroom)
    answered = solve_vroom(
        request,
        _engine(options),
        options.deadline,
        options.seed,
        geometry=options.geometry,
        choose_eta=options.choose_eta,
        source=str(options.vroom),
    )
    text = json.dumps(answered, indent=None if options.json else 2, ensure_ascii=False)
    if options.out is None:
        print(text)
    else:
        try:
            options.out.write_text(f"{text}\n", encoding="utf-8")
        except OSError as error:
            problem = error.strerror or "not writable"
            raise InputError(options.out, problem, "give a path that can be written") from None
    for line in answered.get("warnings", ()):
        complain(f"slipstream: {line}")
    if answered["code"] == 0:
        return 0
    complain(f"slipstream: {answered['error']}")
    return 1 if answered["code"] == INTERNAL_ERROR else 2


def _engine(options: argparse.Namespace) -> RoutingEngine | None:
    if options.network is None:
        if options.objective is not None:
            mend = "give --network, or matrices of costs in the request"
            raise InputError("--objective energy", "needs roads", mend)
        return None
    from dispatcher_daemon.service.vroom import RoutingEngine
    from dispatcher_daemon.traffic import take_snapshot
    from slipstream.freshness import STALE_AFTER_S
    from slipstream.roads.sumo_net import load_network

    roads = load_network(options.network)
    free_flow = take_snapshot(roads, (), 0, stale_after_s=STALE_AFTER_S)
    return RoutingEngine(roads, free_flow, "time" if options.objective is None else "energy")
