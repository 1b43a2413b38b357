"""Vehicles that report positions are shown there, on the plan that they follow."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import viser
from pydantic import ValidationError

from dashboard.live import LiveData, Snapshot
from dashboard.scene.canvas import Canvas
from dashboard.scene.fleet import FleetLayer
from dashboard.server import start_server, stop_server
from dashboard.view.build import build_view
from dashboard.view.vehicles import vehicle_views
from slipstream.bus import free_port
from slipstream.errors import InputError
from slipstream.messages import PlannedStop, VehiclePosition, plan_key, position_key

S = 1_000_000_000


@pytest.fixture
def scene() -> Iterator[viser.SceneApi]:
    """The scene of a server of its own."""
    server = start_server("127.0.0.1", free_port())
    yield server.scene
    stop_server(server)


def _round(world, cycle, time_ns):
    """A plan whose stops begin and end with the depot, as the dispatcher's do."""
    plan = world.plan("van-a", cycle, time_ns)
    begin = PlannedStop(
        stop="depot", node="depot", arrival_ns=plan.depart_ns, departure_ns=plan.depart_ns
    )
    end_ns = plan.segments[-1].exit_ns
    end = begin.model_copy(update={"arrival_ns": end_ns, "departure_ns": end_ns})
    return plan.model_copy(update={"stops": (begin, *plan.stops, end)})


def _position(time_ns, **changes) -> VehiclePosition:
    fields = {
        "vehicle": "van-a",
        "time_ns": time_ns,
        "segment": "avenue_east",
        "share": 0.25,
        "speed_mps": 10.0,
        "on_road": True,
        "cycle": 1,
        "leg": 1,
    }
    return VehiclePosition(**(fields | changes))


def test_a_position_belongs_to_its_vehicle(now_ns):
    """Its key names the vehicle; a leg without a plan is refused."""
    assert position_key("van a") == "slipstream/v1/fleet/van%20a/position"
    with pytest.raises(ValidationError, match="leg is given"):
        _position(now_ns, cycle=None)


def test_a_van_is_shown_where_it_is_not_where_its_plan_puts_it(world, now_ns):
    """A fresh position wins over the plan; one that has grown old is its last known place."""
    plan = _round(world, 1, now_ns)
    snapshot = Snapshot(
        plans={"van-a": plan},
        positions={"van-a": _position(now_ns)},
        followed={"van-a": plan},
    )
    (van,) = vehicle_views(snapshot, now_ns, frozenset())
    assert van.position == ("avenue_east", 0.25)
    (late,) = vehicle_views(snapshot, now_ns + 6 * S, frozenset())
    assert late.position == ("avenue_east", 0.25)
    assert (late.progress.state, late.progress.source) == ("silent", "last")
    assert late.progress.text == f"last: drives to {plan.stops[2].stop}"


def test_a_silent_van_is_red_in_the_3d_view_and_said(world, now_ns, scene):
    """Where it was heard last, with how long ago; not gone, and not where its plan puts it."""
    plan = _round(world, 1, now_ns)
    known = {"plans": {"van-a": plan}, "followed": {"van-a": plan}}
    snapshot = Snapshot(positions={"van-a": _position(now_ns)}, **known)
    layer = FleetLayer(scene, Canvas(world.network))
    layer.update(vehicle_views(snapshot, now_ns, frozenset()), ())
    before = scene.get_handle_by_name("/vans").batched_positions.copy()
    late_ns = now_ns + 210 * S
    view = build_view(snapshot, late_ns, 5.0)
    _, marks = layer.update(view.vehicles, ())
    assert scene.get_handle_by_name("/vans") is None
    assert abs(scene.get_handle_by_name("/planned_vans").batched_positions - before).max() == 0
    (mark,) = [mark for mark in marks if mark.kind == "van"]
    assert (mark.text, mark.urgent) == ("van-a, silent", True)
    assert "van-a tells no position any more" in [trouble.text for trouble in view.troubles]


def test_a_newer_plan_does_not_hide_the_one_that_is_driven(world, now_ns):
    """Cycles go on while a van drives: its route is that of the plan it follows, and it is not
    idle where a cycle left it out.
    """
    live = LiveData(lambda: now_ns)
    old, new = _round(world, 1, now_ns - 60 * S), _round(world, 2, now_ns)
    for message in (old, _position(now_ns - S), new, _position(now_ns)):
        key, take = (
            (plan_key("van-a"), live.on_plan)
            if message in (old, new)
            else (position_key("van-a"), live.on_position)
        )
        take(key, message.to_bytes())
    live.add_history((world.cycle(3, now_ns),), ())
    (van,) = vehicle_views(live.snapshot(), now_ns, frozenset())
    assert (van.plan.cycle, van.idle) == (1, False)
    live.on_position(position_key("van-a"), _position(now_ns, cycle=2).to_bytes())
    (van,) = vehicle_views(live.snapshot(), now_ns, frozenset())
    assert van.plan.cycle == 2


def test_an_unknown_route_is_left_out(world, now_ns):
    """Of a plan that came before the page nothing is claimed but where the van is."""
    snapshot = Snapshot(
        plans={"van-a": _round(world, 5, now_ns)}, positions={"van-a": _position(now_ns)}
    )
    (van,) = vehicle_views(snapshot, now_ns, frozenset())
    assert (van.route, van.plan.stops) == ((), ())
    assert van.position == ("avenue_east", 0.25)


def test_a_position_under_another_key_is_refused(now_ns):
    """A vehicle reports its own position only."""
    live = LiveData(lambda: now_ns)
    with pytest.raises(InputError, match="belongs under"):
        live.on_position(position_key("van-b"), _position(now_ns).to_bytes())


def test_the_marker_moves_with_the_van(world, now_ns, scene):
    """A later position moves the van's marker on the map; one on another net's road shows none."""
    plan = _round(world, 1, now_ns)
    layer = FleetLayer(scene, Canvas(world.network))
    places = []
    for share in (0.1, 0.9):
        snapshot = Snapshot(
            plans={"van-a": plan},
            positions={"van-a": _position(now_ns, share=share)},
            followed={"van-a": plan},
        )
        layer.update(vehicle_views(snapshot, now_ns, frozenset()), ())
        places.append(scene.get_handle_by_name("/vans").batched_positions.copy())
    assert abs(places[1] - places[0]).max() > 0
    strange = Snapshot(
        plans={"van-a": plan},
        positions={"van-a": _position(now_ns, segment="elsewhere")},
        followed={"van-a": plan},
    )
    layer.update(vehicle_views(strange, now_ns, frozenset()), ())
    assert scene.get_handle_by_name("/vans") is None


def test_a_vehicle_by_plan_is_drawn_translucent(world, now_ns, scene):
    """Until it reports where it is."""
    plan = world.plan("van-a", 1, now_ns)
    middle_ns = (plan.segments[0].entry_ns + plan.segments[0].exit_ns) // 2
    layer = FleetLayer(scene, Canvas(world.network))
    told = Snapshot(plans={"van-a": plan})
    layer.update(vehicle_views(told, middle_ns, frozenset()), ())
    assert scene.get_handle_by_name("/vans") is None
    assert 0 < scene.get_handle_by_name("/planned_vans").opacity < 0.6
    position = {"van-a": _position(middle_ns)}
    heard = Snapshot(plans={"van-a": plan}, positions=position, followed={"van-a": plan})
    layer.update(vehicle_views(heard, middle_ns, frozenset()), ())
    assert scene.get_handle_by_name("/vans").opacity is None
    assert scene.get_handle_by_name("/planned_vans") is None
