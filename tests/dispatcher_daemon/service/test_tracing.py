"""A cycle's trace."""

from __future__ import annotations

import pytest

from dispatcher_daemon.forms.problem import RoutingProblem
from dispatcher_daemon.service.dispatcher import Dispatcher
from dispatcher_daemon.solvers.exact import ExactSolver
from dispatcher_daemon.solvers.workers.pool import SolverPool
from slipstream.service.tracing import Tracing
from tests.dispatcher_daemon.service.logged import SETTINGS, Log, State, feed
from tests.slipstream.collector import collector


@pytest.mark.process
@pytest.mark.slow
def test_a_cycle_is_traced_from_state_to_plan(demo: RoutingProblem, state: State) -> None:
    """Its stages, and by which states of which RSU it went."""
    with collector() as found:
        with Tracing("dispatcher", found.endpoint), SolverPool([ExactSolver()]) as pool:
            for form in ("arc", "route"):
                settings = SETTINGS.model_copy(update={"form": form})
                dispatcher = Dispatcher(settings, demo.network, demo.fleet, Log(), Log(), pool)
                feed(dispatcher, state, "avenue_east", 1)
                dispatcher.run_cycle()
        arc, route = [found.tree(each) for each in found.spans if each.name == "cycle"]
        received = [each.attributes for each in found.spans if each.name == "receive"]
        (shot, _) = [each.attributes for each in found.spans if each.name == "snapshot"]
        (cycle, _) = [each.attributes for each in found.spans if each.name == "cycle"]
    stages = ["snapshot", "solve", "verify", "store", "publish"]
    assert list(arc) == stages
    # The base plan is verified at once, the plan of the blocks behind them.
    assert list(route) == ["snapshot", "base routes", "verify", "blocks", "store", "publish"]
    assert "solve" in route["blocks"]
    (one, *_) = received
    assert shot["states"] == [f"{one['rsu']} {one['segment']} {one['sequence']}"]
    assert cycle == {"cycle": 7, "status": "ok", "plans": 2}
