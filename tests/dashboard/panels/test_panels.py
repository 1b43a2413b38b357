"""The panels say what the view model holds, and no foreign word becomes markup."""

from __future__ import annotations

from html.parser import HTMLParser

import msgspec
import pytest
from jinja2 import UndefinedError

from dashboard.live import Snapshot
from dashboard.panels.card import card_html
from dashboard.panels.environment import render
from dashboard.selection import Selection
from dashboard.view.build import DashboardView, build_view
from dashboard.view.model import PreviewView

S = 1_000_000_000
SCRIPT = "<script>alert(1)</script>"
EVIL = '<img src=x onerror="alert(1)">&"'


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
    return cards | {"summary": _summary(view)}


def _view(snapshot, now_ns):
    return build_view(snapshot, now_ns, 5.0)


def _summary(view: DashboardView) -> str:
    return render("summary.html.j2", view=view)


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
    gates = tuple(
        gate.model_copy(update={"segment": EVIL, "y_e": None, "reason": EVIL})
        for gate in report.gates
    )
    report = report.model_copy(update={"gates": gates})
    snapshot = Snapshot(
        states={(EVIL, EVIL): state},
        rsus={EVIL: health},
        plans={EVIL: plan},
        cycles=(report, report),
        history_problem=EVIL,
    )
    for name, block in _blocks(_view(snapshot, now_ns)).items():
        tags = _Tags()
        tags.feed(block)
        assert not tags.open, name
        assert not any(attribute == "onerror" for _, attribute in tags.seen), name
        assert ("img", None) not in tags.seen, name


@pytest.mark.parametrize("name", ["van", "road", "rsu"])
def test_a_script_in_an_id_arrives_as_text(world, now_ns, name):
    """A vehicle, segment, RSU or stop whose id is a script is shown letter by letter."""
    script = SCRIPT
    state = msgspec.structs.replace(world.state("avenue_east", now_ns), segment=script, rsu=script)
    health = world.health("avenue_east", now_ns).model_copy(update={"rsu": script})
    plan = world.plan("van-a", 1, now_ns).model_copy(update={"vehicle": script})
    snapshot = Snapshot(
        states={(script, script): state},
        rsus={script: health},
        plans={script: plan},
    )
    view = _view(snapshot, now_ns)
    block = card_html(view, Selection(name, script), "http://page.example")
    assert "<script" not in block
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in block


def test_a_name_that_a_template_lacks_is_an_error():
    """A template without its data fails instead of showing an empty block."""
    with pytest.raises(UndefinedError, match="'view' is undefined"):
        render("summary.html.j2")


def test_an_empty_world(now_ns):
    """Before the first message each block says what it waits for."""
    summary = _summary(_view(Snapshot(), now_ns))
    assert "Waiting for the first roadside camera" in summary
    assert "The dispatcher has not been heard" in summary


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


def test_an_old_picture_is_faded(world, now_ns):
    """A picture that has stopped moving is grey and called old."""
    health = world.health("avenue_east", now_ns)
    view = _view(Snapshot(rsus={health.rsu: health}), now_ns)
    old = PreviewView(world.jpeg(), 60.0, stale=True)
    block = card_html(view, Selection("rsu", health.rsu), None, old)
    assert "grayscale" in block
    assert "old picture, 60 s ago" in block
    assert block.count("<img") == 1
    assert "No picture comes" in card_html(view, Selection("rsu", health.rsu), None)
