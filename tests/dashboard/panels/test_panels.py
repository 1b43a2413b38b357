"""The panels say what the view model holds, and no foreign word becomes markup."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import msgspec
import pytest
from jinja2 import UndefinedError

import dashboard.panels
from dashboard.live import Snapshot
from dashboard.panels import PANELS, card_html
from dashboard.panels.environment import MAX_UNSERVED, render
from dashboard.selection import Selection
from dashboard.view import DashboardView, build_view
from slipstream.messages import Unserved

S = 1_000_000_000
SCRIPT = "<script>alert(1)</script>"
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
    cards = {
        f"card of the {kind}": card_html(view, Selection(kind, name), "http://page.example")
        for kind, name in (("van", EVIL), ("road", EVIL), ("rsu", EVIL), ("van", SCRIPT))
    }
    return {panel.name: panel.html(view) for panel in PANELS} | cards


def _view(snapshot, now_ns):
    return build_view(snapshot, now_ns, stale_after_s=5.0, silent_after_s=30.0)


def test_foreign_text_is_escaped(world, now_ns):
    """Names and reasons full of markup come out as text in every block, and tags balance."""
    state = msgspec.structs.replace(world.state("avenue_east", now_ns), segment=EVIL, rsu=EVIL)
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
        assert name == "card of the rsu" or ("img", None) not in tags.seen, name


@pytest.mark.parametrize("name", ["van", "road", "rsu", "cycle"])
def test_a_script_in_an_id_arrives_as_text(world, now_ns, name):
    """A vehicle, segment, RSU or stop whose id is a script is shown letter by letter."""
    script = SCRIPT
    state = msgspec.structs.replace(world.state("avenue_east", now_ns), segment=script, rsu=script)
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
    view = _view(snapshot, now_ns)
    block = (
        _html(name, view)
        if name == "cycle"
        else card_html(view, Selection(name, script), "http://page.example")
    )
    assert "<script" not in block
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in block


def test_each_template_has_its_panel():
    """Panels have unique names, and no template lies unused beside theirs and the shared ones."""
    assert len({panel.name for panel in PANELS}) == len(PANELS)
    folder = Path(dashboard.panels.__file__).parent / "templates"
    shared = {"macros.html.j2", "style.html.j2", "card.html.j2", "frame.html.j2"}
    assert {path.name for path in folder.iterdir()} == {p.template for p in PANELS} | shared


def test_a_name_that_a_template_lacks_is_an_error():
    """A template without its data fails instead of showing an empty block."""
    with pytest.raises(UndefinedError, match="'data' is undefined"):
        render("cycle.html.j2", title="Last dispatch cycle")


def test_an_empty_world(now_ns):
    """Before the first message each block says what it waits for."""
    blocks = _blocks(_view(Snapshot(), now_ns))
    assert "Waiting for the first roadside camera" in blocks["summary"]
    assert "None yet" in blocks["cycle"]


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
    view = _view(snapshot, now_ns)
    block = card_html(view, Selection("road", "avenue_east"), None)
    assert "no fresh data" in block
    assert "Platooning open in cycle #3; not now: traffic is unknown." in block
    block = card_html(view, Selection("road", "avenue_west"), None)
    assert "Platooning closed in cycle #3, turbulent traffic." in block


def test_a_card_leads_to_the_operators_page(world, now_ns):
    """The link names the same thing there; without an address there is none."""
    view = _view(Snapshot(plans={"van-a": world.plan("van-a", 1, now_ns)}), now_ns)
    chosen = Selection("van", "van-a")
    block = card_html(view, chosen, "https://page.example/slipstream/")
    assert 'href="https://page.example/slipstream/#van/van-a"' in block
    assert "c2 → c1" in block
    assert "href" not in card_html(view, chosen, None)
    odd = card_html(view, Selection("road", "a/b c#1"), "http://x")
    assert 'href="http://x/#road/a%2Fb%20c%231"' in odd


def test_what_is_not_there_is_said_to_be_missing(world, now_ns):
    """A selection that no message names has a card that says so; none at all says how to select."""
    view = _view(Snapshot(), now_ns)
    assert "No camera watches it" in card_html(view, Selection("road", "side_street"), None)
    assert "no such vehicle" in card_html(view, Selection("van", "ghost"), None)
    assert "Click a vehicle" in card_html(None, None, None)


def test_a_way_back_to_the_operators_page_is_always_there():
    """Also with nothing selected; not where the page has no address."""
    assert 'href="https://page.example/x/"' in card_html(None, None, "https://page.example/x/")
    assert "href" not in card_html(None, None, None)


def test_a_loss_is_called_a_loss(world, now_ns):
    """A plan that needs more than its baseline is said to cost, not to save."""
    report = world.cycle(3, now_ns)
    worse = report.energy.model_copy(update={"cooperative_kwh": report.energy.baseline_kwh + 0.1})
    view = _view(Snapshot(cycles=(report.model_copy(update={"energy": worse}),)), now_ns)
    assert "costs <b>0.100 kWh" in _html("cycle", view)
    assert "Plans cost more" in _html("summary", view)


def test_an_old_picture_is_faded(world, now_ns):
    """A picture that has stopped moving is grey and called old; one of another RSU is not shown."""
    health = world.health("avenue_east", now_ns)
    pictures = {name: (world.jpeg(), now_ns - 60 * S) for name in (health.rsu, "other")}
    view = _view(Snapshot(rsus={health.rsu: health}, previews=pictures), now_ns)
    block = card_html(view, Selection("rsu", health.rsu), None)
    assert "grayscale" in block
    assert "old picture, 60 s ago" in block
    assert block.count("<img") == 1
    view = _view(Snapshot(rsus={health.rsu: health}), now_ns)
    assert "No picture yet" in card_html(view, Selection("rsu", health.rsu), None)


def _cycle_view(world, now_ns, *unserved: Unserved) -> DashboardView:
    report = world.cycle(3, now_ns).model_copy(update={"unserved": unserved})
    return _view(Snapshot(cycles=(report,)), now_ns)


def test_unserved_stops_are_listed(world, now_ns):
    """The head counts them, and the cycle's panel names the first few with reasons as they came."""
    stops = [Unserved(stop=f"c_{n}", reason=f"loaded on 'van_{n}'") for n in range(12)]
    view = _cycle_view(world, now_ns, *stops)
    assert "12 stops not in the plan" in _html("summary", view)
    block = _html("cycle", view)
    assert "12 stops not in the plan" in block
    for n in range(MAX_UNSERVED):
        assert f"<td>c_{n}</td>" in block
        assert f"loaded on &#39;van_{n}&#39;" in block
    assert f"c_{MAX_UNSERVED}" not in block
    assert f"and {12 - MAX_UNSERVED} more" in block
    one = _html("cycle", _cycle_view(world, now_ns, stops[0]))
    assert "1 stop not in the plan" in one
    assert "more</small>" not in one


def test_nothing_is_said_where_all_stops_are_served(world, now_ns):
    """A cycle that serves every stop has no word on stops that it does not."""
    view = _cycle_view(world, now_ns)
    assert "not in the plan" not in _html("cycle", view) + _html("summary", view)
