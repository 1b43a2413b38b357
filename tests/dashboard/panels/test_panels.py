"""The panels say what the view model holds, and no foreign word becomes markup."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import pytest
from jinja2 import UndefinedError

import dashboard.panels
from dashboard.live import Snapshot
from dashboard.panels import PANELS
from dashboard.panels.environment import MAX_ROWS, MAX_UNSERVED, render
from dashboard.view import DashboardView, build_view
from slipstream.messages import Unserved

S = 1_000_000_000
EVIL = '<img src=x onerror="alert(1)">&"'


def _html(name: str, view: DashboardView) -> str:
    """The HTML of one panel."""
    return next(panel.html(view) for panel in PANELS if panel.name == name)


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.seen: set[tuple[str, str | None]] = set()

    def handle_starttag(self, tag, attrs):
        self.seen |= {(tag, name) for name, _ in attrs} | {(tag, None)}
        if tag not in ("br", "img", "line", "path", "circle"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in ("line", "path", "circle"):
            assert self.open.pop() == tag


def _blocks(view: DashboardView) -> dict[str, str]:
    return {panel.name: panel.html(view) for panel in PANELS}


def _view(snapshot, now_ns):
    return build_view(snapshot, now_ns, stale_after_s=5.0, silent_after_s=30.0)


def test_foreign_text_is_escaped(world, now_ns):
    """Names and reasons full of markup come out as text in every block, and tags balance."""
    state = world.state("avenue_east", now_ns).model_copy(update={"segment": EVIL, "rsu": EVIL})
    health = world.health("avenue_east", now_ns).model_copy(update={"rsu": EVIL})
    plan = world.plan("van-a", 1, now_ns)
    plan = plan.model_copy(
        update={
            "vehicle": EVIL,
            "stops": tuple(stop.model_copy(update={"stop": EVIL}) for stop in plan.stops),
        }
    )
    report = world.cycle(1, now_ns)
    report = report.model_copy(
        update={
            "reason": EVIL,
            "solver": EVIL,
            "solvers": tuple(
                run.model_copy(update={"solver": EVIL, "reason": EVIL}) for run in report.solvers
            ),
            "gates": tuple(
                gate.model_copy(update={"segment": EVIL, "y_e": None, "reason": EVIL})
                for gate in report.gates
            ),
            "energy": report.energy.model_copy(update={"baseline": EVIL}),
            "unserved": (Unserved(stop=EVIL, reason=EVIL),),
        }
    )
    snapshot = Snapshot(
        states={(EVIL, EVIL): state},
        rsus={EVIL: health},
        plans={EVIL: plan},
        cycles=(report, report),
        previews={EVIL: (world.jpeg(), now_ns)},
        history_problem=EVIL,
    )
    for name, block in _blocks(_view(snapshot, now_ns)).items():
        tags = _Tags()
        tags.feed(block)
        assert not tags.open, name
        assert not any(attribute == "onerror" for _, attribute in tags.seen), name
        assert name == "cameras" or ("img", None) not in tags.seen, name


@pytest.mark.parametrize("name", ["roads", "vehicles", "rsus", "cameras", "cycle"])
def test_a_script_in_an_id_arrives_as_text(world, now_ns, name):
    """A vehicle, segment, RSU or stop whose id is a script is shown letter by letter."""
    script = "<script>alert(1)</script>"
    state = world.state("avenue_east", now_ns).model_copy(update={"segment": script, "rsu": script})
    health = world.health("avenue_east", now_ns).model_copy(update={"rsu": script})
    plan = world.plan("van-a", 1, now_ns).model_copy(update={"vehicle": script})
    report = world.cycle(1, now_ns - S).model_copy(
        update={"unserved": (Unserved(stop=script, reason="no way"),)}
    )
    snapshot = Snapshot(
        states={(script, script): state},
        rsus={script: health},
        plans={script: plan},
        cycles=(report,),
        previews={script: (world.jpeg(), now_ns)},
    )
    block = _html(name, _view(snapshot, now_ns))
    assert "<script" not in block
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in block


def test_each_template_has_its_panel():
    """Panels have unique names, and no template lies unused beside theirs and the shared ones."""
    assert len({panel.name for panel in PANELS}) == len(PANELS)
    folder = Path(dashboard.panels.__file__).parent / "templates"
    shared = {"macros.html.j2", "style.html.j2"}
    assert {path.name for path in folder.iterdir()} == {p.template for p in PANELS} | shared


def test_a_name_that_a_template_lacks_is_an_error():
    """A template without its data fails instead of showing an empty block."""
    with pytest.raises(UndefinedError, match="'data' is undefined"):
        render("roads.html.j2", title="Watched roads")


def test_an_empty_world(now_ns):
    """Before the first message each block says what it waits for."""
    blocks = _blocks(_view(Snapshot(), now_ns))
    assert "Waiting for the first roadside camera" in blocks["summary"]
    assert "No camera has reported yet" in blocks["roads"]
    assert "No plan has been sent yet" in blocks["vehicles"]
    assert "None yet" in blocks["cycle"]
    assert "None has reported yet" in blocks["rsus"]
    assert "Waiting for the first camera picture" in blocks["cameras"]


def test_the_cycle_names_its_baseline_and_split(world, now_ns):
    """The saving stands with its baseline and its three parts; raw and repaired stand apart."""
    block = _html("cycle", _view(Snapshot(cycles=(world.cycle(3, now_ns),)), now_ns))
    for piece in (
        "each van alone on its cheapest route",
        "distance <b>+0.000</b>",
        "drag <b>+0.071</b>",
        "acceleration <b>+0.000</b>",
        "cost objective <b>1.583 kWh</b>",
        "0.024%",
        "100%",
        "feasible (repaired)",
    ):
        assert piece in block


def test_a_road_that_has_changed_since_the_last_cycle(world, now_ns):
    """What a road is now, and what the last cycle made of it, stand apart."""
    state = world.state("avenue_east", now_ns - 9 * S)
    snapshot = Snapshot(
        states={("avenue_east", state.rsu): state}, cycles=(world.cycle(3, now_ns),)
    )
    block = _html("roads", _view(snapshot, now_ns))
    assert "now: no fresh data · platooning open in cycle #3" in block
    assert "platooning closed in cycle #3, turbulent traffic" in block


def test_a_loss_is_called_a_loss(world, now_ns):
    """A plan that needs more than its baseline is said to cost, not to save."""
    report = world.cycle(3, now_ns)
    worse = report.energy.model_copy(update={"cooperative_kwh": report.energy.baseline_kwh + 0.1})
    view = _view(Snapshot(cycles=(report.model_copy(update={"energy": worse}),)), now_ns)
    assert "costs <b>0.100 kWh" in _html("cycle", view)
    assert "Extra" in _html("summary", view)


def test_long_tables_are_cut(world, now_ns):
    """A table ends after so many rows and says how many are left out."""
    rsus = {f"rsu-{n:03}": world.health(f"road-{n:03}", now_ns) for n in range(60)}
    block = _html("rsus", _view(Snapshot(rsus=rsus), now_ns))
    assert block.count("<tr>") == MAX_ROWS + 1
    assert "and 40 more" in block


def test_an_old_picture_is_faded(world, now_ns):
    """A picture that has stopped moving is grey and called old."""
    view = _view(Snapshot(previews={"a": (world.jpeg(), now_ns - 60 * S)}), now_ns)
    block = _html("cameras", view)
    assert "grayscale" in block
    assert "old picture, 60 s ago" in block


def _cycle_view(world, now_ns, *unserved: Unserved) -> DashboardView:
    report = world.cycle(3, now_ns).model_copy(update={"unserved": unserved})
    return _view(Snapshot(cycles=(report,)), now_ns)


def test_unserved_stops_are_listed(world, now_ns):
    """The head counts them, and the cycle's panel names the first few with reasons as they came."""
    stops = [Unserved(stop=f"c_{n}", reason=f"loaded on 'van_{n}'") for n in range(12)]
    view = _cycle_view(world, now_ns, *stops)
    assert "12 stops not served" in _html("summary", view)
    block = _html("cycle", view)
    assert "12 stops not served" in block
    for n in range(MAX_UNSERVED):
        assert f"<td>c_{n}</td>" in block
        assert f"loaded on &#39;van_{n}&#39;" in block
    assert f"c_{MAX_UNSERVED}" not in block
    assert f"and {12 - MAX_UNSERVED} more" in block
    one = _html("cycle", _cycle_view(world, now_ns, stops[0]))
    assert "1 stop not served" in one
    assert "more</small>" not in one


def test_nothing_is_said_where_all_stops_are_served(world, now_ns):
    """A cycle that serves every stop has no word on stops that it does not."""
    view = _cycle_view(world, now_ns)
    assert "not served" not in _html("cycle", view) + _html("summary", view)


def test_a_large_fleet_stays_readable(world, now_ns):
    """Of 200 vans the first rows are listed, the idle ones after the others and counted."""
    plans = {f"van-{n:03}": world.plan("van-a", 3, now_ns) for n in range(200)}
    plans = {name: plan.model_copy(update={"vehicle": name}) for name, plan in plans.items()}
    assert "and 180 more" in _html("vehicles", _view(Snapshot(plans=plans), now_ns))
    idle = {"stops": (), "segments": (), "distance_m": 0.0, "energy_kwh": 0.0}
    for n in range(0, 200, 2):
        plans[f"van-{n:03}"] = plans[f"van-{n:03}"].model_copy(update=idle)
    block = _html("vehicles", _view(Snapshot(plans=plans), now_ns))
    assert "Vans (200, 100 idle)" in block
    assert block.count("<tr>") == MAX_ROWS + 1
    assert "van-001" in block
    assert "van-000" not in block
    one = _html("vehicles", _view(Snapshot(plans={"van-000": plans["van-000"]}), now_ns))
    assert '<td class="l">idle</td>' in one
    assert "0.0" not in one
