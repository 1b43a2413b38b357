"""The operator's page in a browser, before a server that speaks docs/page.md."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.dashboard.web.browser import SIZES, TABS, geometry_faults, open_page, until
from tests.dashboard.web.pages import city
from tests.dashboard.web.pages.fake import TOKEN, FakePage

pytestmark = [pytest.mark.process, pytest.mark.slow]
NET = city.network(120)
ROAD = "e1-0ha"


@pytest.fixture
def page() -> Iterator[FakePage]:
    """A small city on a server of its own."""
    moment = city.moment(NET, vans=40, rsus=50, orders=80)
    with FakePage(NET, moment) as running:
        yield running


@pytest.fixture
def opened(browser: Any, page: FakePage) -> Iterator[Callable[..., Any]]:
    """Opens the page; at the end nothing may have gone wrong in it."""
    contexts = []

    def start(path: str = "", width: int = 1440, theme: str = "light", **more: Any) -> Any:
        size = {"width": width, "height": SIZES[width]}
        context = browser.new_context(viewport=size, color_scheme=theme, **more)
        contexts.append(context)
        return open_page(context, page, path)

    yield start
    for context in contexts:
        for tab in context.pages:
            assert tab.faults == []
        context.close()


def rows(tab: Any) -> list[str]:
    """The rows of the table in view, from the top."""
    found: list[str] = tab.locator(".pane:not([hidden]) tr[data-id]").evaluate_all(
        "rows => rows.map((row) => row.dataset.id)"
    )
    return found


@pytest.mark.long
def test_each_tab_shows_its_rows_and_trouble_comes_before_names(opened):
    """Tables, cameras and energy; the first row is what is worst."""
    tab = opened()
    assert rows(tab)[:5] == ["van-8", "van-24", "van-40", "van-20", "van-1"]
    first = {
        "roads": NET["roads"][40]["id"],
        "rsus": "rsu-37",
        "orders": "o-5",
        "cycles": "120",
        "alarms": "a-1",
    }
    for name, row in first.items():
        tab.click(f"#tab-{name}")
        assert rows(tab)[0] == row, name
    tab.click("#tab-cameras")
    assert tab.locator(".camera").count() == 6
    until(tab, "document.querySelectorAll('.camera img:not([hidden])').length === 6")
    tab.click("#tab-energy")
    tab.wait_for_selector("#pane-energy rect.drag")
    shown = tab.inner_text("#pane-energy")
    assert "41.3\u00a0kWh" in shown
    assert "each vehicle alone on its shortest way" in shown
    assert "−3.30\u00a0kWh" in shown


@pytest.mark.long
def test_a_table_is_sorted_by_its_headings_and_filtered_by_words(opened):
    """Each word has to be somewhere in the row; the count says what is left."""
    tab = opened("?tab=orders")
    tab.click("[data-sort=eta]")
    tab.click("[data-sort=eta]")
    cells = tab.locator("#pane-orders td[data-column=eta]").all_inner_texts()
    assert cells == sorted(cells)
    assert len(set(cells)) > 3
    tab.fill("#filter", "van-4 delayed")
    assert rows(tab) == ["o-3"]
    assert tab.inner_text("#shown") == "1 of 80 rows"
    tab.fill("#filter", "nothing has this")
    assert "Nothing matches" in tab.inner_text("#pane-orders")
    tab.click("#glance [data-tab=rsus][data-filter=trouble]")
    assert rows(tab) == ["rsu-37", "rsu-12"]


@pytest.mark.long
def test_a_subject_is_selected_by_click_by_search_by_address_and_after_a_reload(opened):
    """The address always says what is selected."""
    tab = opened()
    tab.click("tr[data-id=van-20]")
    assert tab.inner_text("#card-title") == "van-20"
    assert tab.url.endswith("#van/van-20")
    tab.keyboard.press("/")
    tab.keyboard.type("RSU-1")
    assert tab.locator("#found li").count() == 11
    tab.keyboard.press("ArrowDown")
    tab.keyboard.press("Enter")
    assert tab.inner_text("#card-title") == "rsu-10"
    assert tab.get_attribute("#scene", "href") == "http://127.0.0.1:8081/?select=rsu%2Frsu-10"
    tab.reload()
    tab.wait_for_selector("html[data-ready]")
    assert tab.inner_text("#card-title") == "rsu-10"
    tab.evaluate("location.hash = '#order/o-3'")
    until(tab, "document.getElementById('card-title').textContent === 'o-3'")
    tab.go_back()
    until(tab, "document.getElementById('card-title').textContent === 'rsu-10'")
    tab.click("#card-close")
    assert tab.locator("#card").is_hidden()


CARDS = {
    "#van/van-1": (
        [
            "Next stop",
            "p-1, place 1",
            "van-2",
            "Why this route",
            "0.3 kWh less",
            "Why this platoon",
        ],
        ".timeline .platoon",
    ),
    f"#road/{ROAD}": (
        [
            *("mean speed", "crossed", "speed spread", "van-4", "van-9", "Watched by"),
            *("Vehicles counted", "motorcycle", "41.3 ± 0.6 km/h", "85 % no faster than"),
            "93\u00a0%, the rest not: the camera's picture is black",
        ],
        ".chart .threshold",
    ),
    "#rsu/rsu-5": (["Frames/s", "speeds within ±2.1\u00a0%", "decode error"], ".picture img"),
    "#order/o-4": (["Window", "Lock to a vehicle", "van-1", "under way", "42\u00a0kg"], ".small"),
    "#cycle/119": (["Solvers", "exact", "o-5", "time window", "drag"], ".split .drag"),
    "#alarm/a-1": (
        ["Look at its power", "Roadside unit rsu-37", "25\u00a0min", "not yet"],
        ".chip",
    ),
}


@pytest.mark.long
def test_a_card_tells_all_about_its_subject(opened):
    """Figures, lists and drawings of each kind."""
    tab = opened()
    for address, (texts, mark) in CARDS.items():
        tab.evaluate("(hash) => { location.hash = hash; }", address)
        tab.wait_for_selector(f"#card-body {mark}", state="attached")
        # The row is drawn at once, what has to be asked for later.
        for text in texts:
            shown = "document.getElementById('card-body').innerText.toLowerCase()"
            until(tab, f"{shown}.includes({json.dumps(text.lower())})")


@pytest.mark.long
def test_a_card_follows_its_row_and_keeps_where_the_reader_is(opened, page: FakePage):
    """A change is drawn into what is there: the focus stays."""
    tab = opened("#van/van-1")
    tab.wait_for_selector("#card-body .timeline")
    tab.focus("#card-body a >> nth=0")
    before = tab.evaluate("document.activeElement.textContent")
    page.send(set={"vehicles": {"van-1": {"delay_s": 1200, "level": "bad"}}})
    until(tab, "document.querySelector('#card-body').innerText.includes('+20')")
    assert tab.evaluate("document.activeElement.textContent") == before
    until(tab, "document.querySelector('#pane-vehicles tr[data-id]').dataset.id === 'van-1'")
    page.send(delete={"vehicles": ["van-1"]})
    until(tab, "!document.querySelector('tr[data-id=van-1]')")


@pytest.mark.long
def test_a_moment_of_the_past_is_shown_with_its_card_and_played(opened, page: FakePage):
    """By the slider, by the address, and on at 60 times; then live again."""
    tab = opened("#van/van-1")
    assert tab.inner_text("#badge") == "Live"
    tab.wait_for_selector("#time-slider:not([disabled])")
    wanted = city.T0 - city.HOUR
    tab.evaluate(
        """(t) => { const slider = document.getElementById("time-slider");
        slider.value = t; slider.dispatchEvent(new Event("input")); }""",
        wanted,
    )
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    until(tab, "document.getElementById('card-body').innerText.includes('as of')")
    assert f"t={wanted}" in tab.url
    assert "18 Nov 2026, 10:06" in tab.inner_text("#time-badge")
    assert any(f"/api/vehicles/van-1?t={wanted}" in asked for asked in page.asked)
    tab.select_option("#time-rate", "60")
    tab.click("#time-play")
    until(tab, f"+new URLSearchParams(location.search).get('t') > {wanted + 30_000}")
    tab.reload()
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    tab.click("#time-live")
    assert tab.inner_text("#badge") == "Live"
    assert "as of" not in tab.inner_text("#card-body")
    assert "t=" not in tab.url


@pytest.mark.long
def test_nothing_looks_well_that_is_not_known(opened, page: FakePage):
    """The badge behind a dead bus, RSUs at a glance, and the card of one that was never heard."""
    tab = opened("#rsu/rsu-1")
    unheard = {"status": "never heard", "why": "never heard", "level": "idle", "fps": None}
    unheard |= {"seen": None, "faults": None, "vehicles": None, "picture": False}
    well = {"level": "ok", "why": None}
    names = [name for name in page.moment["rsus"] if name != "rsu-1"]
    page.send(set={"rsus": {"rsu-1": unheard} | dict.fromkeys(names, well)})
    until(tab, "document.getElementById('glance').innerText.includes('1 not known')")
    until(tab, "/Last heard\\s+never/.test(document.getElementById('card-body').innerText)")
    assert "not known" in tab.inner_text("#card-body")
    item = {"subject": "bus", "level": "bad", "text": "The message bus", "since": None}
    page.send(status={"level": "bad", "text": "The message bus", "count": 1, "items": [item]})
    until(tab, "document.getElementById('badge').dataset.state === 'lost'")
    assert tab.inner_text("#badge") == "Not up to date"


@pytest.mark.long
def test_a_finished_run_opens_at_its_last_moment(opened, page: FakePage):
    """There is no live stream to ask for."""
    page.config["live"] = False
    tab = opened()
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    assert f"as of {city.T0}" in tab.inner_text("#pane-vehicles")
    assert tab.locator("#time-live").is_hidden()
    assert not any("/api/live" in asked for asked in page.asked)


@pytest.mark.long
def test_an_action_asks_first_and_shows_the_answer(opened, page: FakePage):
    """The token is asked for once, and again after it was refused."""
    page.moment["orders"]["o-4"].update(state="planned", source="api")
    tab = opened("#order/o-4")
    tab.click("text=Lock to a vehicle")
    assert tab.input_value("#action-vehicle") == "van-5"
    tab.click("#action-close")
    assert page.actions == []
    tab.click("text=Cancel the order")
    tab.fill("#action-reason", "customer rang")
    tab.fill("#action-token", "wrong")
    tab.click("#action-send")
    until(tab, "document.getElementById('action-answer').textContent.includes('Ask the')")
    tab.fill("#action-token", TOKEN)
    tab.click("#action-send")
    until(tab, "document.getElementById('action-answer').textContent.startsWith('Done')")
    assert page.actions == [
        {"action": "cancel", "subject": "order/o-4", "vehicle": None, "reason": "customer rang"}
    ]
    tab.click("#action-close")
    tab.click("#control summary")
    tab.click("#pause")
    assert tab.locator("#action-token-line").is_hidden()
    tab.click("#action-send")
    until(tab, "document.getElementById('action-answer').textContent.includes('pause')")
    assert page.actions[-1]["subject"] == "dispatcher"
    tab.faults.clear()  # the browser logs the refused token


@pytest.mark.long
def test_without_control_nothing_can_be_asked_for(opened, page: FakePage):
    """No button of an action is there."""
    page.config["control"] = False
    tab = opened("#order/o-4")
    tab.wait_for_selector("#card-body .small")
    assert tab.locator("[data-action]:visible").count() == 0


@pytest.mark.long
def test_what_would_be_refused_is_not_offered(opened, page: FakePage):
    """Behind a silent dispatcher, of the past, while paused, by the order's state and the alarm."""
    orders = page.moment["orders"]
    orders["o-4"].update(state="planned", source="api")
    orders["o-8"].update(state="under_way", source="api", vehicle="van-9")
    orders["o-9"].update(state="planned", source="file")
    page.moment["alarms"]["page/bus/bad"] = {**page.moment["alarms"]["a-1"], "subject": "bus"}
    tab = opened("#order/o-4")

    def offered(path: str) -> list[str]:
        tab.goto(page.url + path)
        tab.wait_for_selector("#card-body .facts")
        return tab.locator("#card [data-action]").all_inner_texts()

    assert offered("#order/o-4") == ["Lock to a vehicle", "Cancel the order"]
    assert offered("#order/o-8") == ["Lock to a vehicle"]
    tab.click("#card [data-action=pin]")
    assert tab.locator("#action-vehicle option").all_inner_texts() == ["choose one", "van-9"]
    tab.click("#action-close")
    assert offered("#order/o-9") == ["Lock to a vehicle"]
    assert offered("#order/o-2") == []
    assert offered("#alarm/a-1") == ["Acknowledge"]
    assert offered("#alarm/a-4") == offered("#alarm/page/bus/bad") == []
    tab.click("#control summary")
    assert tab.locator("#control [data-action]:visible").all_inner_texts() == ["Pause", "Solve now"]
    page.send(paused=True)
    until(
        tab, "document.getElementById('solve').hidden && !document.getElementById('resume').hidden"
    )
    offered("#order/o-4")
    page.send(dispatcher_heard=False)
    until(tab, "document.querySelector('#control').hidden")
    until(tab, "!document.querySelector('#card [data-action]')")
    page.send(dispatcher_heard=True)
    until(tab, "document.querySelector('#card [data-action]') !== null")
    tab.goto(f"{page.url}?t={city.T0 - city.HOUR}#order/o-4")
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    until(tab, "document.querySelector('#control').hidden")
    assert tab.locator("#card [data-action]").count() == 0


@pytest.mark.long
def test_the_banner_tells_the_worst_first_and_counts_in_the_title(opened, page: FakePage):
    """The others are behind "and N more"."""
    tab = opened()
    assert tab.locator("#banner").get_attribute("role") == "alert"
    assert tab.inner_text("#banner").split("\n") == ["rsu-37 has no signal", "and 2 more"]
    assert tab.title().startswith("(3) ")
    tab.click("#banner [data-more]")
    assert "picture frozen" in tab.inner_text("#banner")
    tab.click("#banner a >> nth=0")
    assert tab.inner_text("#card-title") == "rsu-37"
    page.send(status={"level": "ok", "text": "", "count": 0, "items": []})
    tab.wait_for_selector("#banner", state="hidden")
    assert tab.title() == "Troy – Slipstream"


@pytest.mark.long
def test_a_lost_server_is_told_greys_the_page_and_is_found_again(opened, page: FakePage):
    """Within five seconds, in words."""
    tab = opened()
    page.down()
    until(
        tab,
        "document.getElementById('banner').innerText.includes('connection to the server is lost')",
        timeout_s=5,
    )
    assert tab.evaluate("getComputedStyle(document.getElementById('map')).filter") == "grayscale(1)"
    assert tab.inner_text("#badge") == "No connection"
    page.up()
    until(tab, "document.getElementById('badge').textContent === 'Live'")
    assert "lost" not in tab.inner_text("#banner")
    tab.faults.clear()  # the browser logs refused connections


@pytest.mark.long
def test_a_name_with_a_script_stays_a_text(opened, page: FakePage):
    """In tables, cards, banner and address."""
    name = "<img src=x onerror=alert(1)>/ä"
    page.moment["orders"][name] = dict(page.moment["orders"]["o-5"], why="<b>bold</b>")
    page.moment["status"]["items"][0]["text"] = "<script>alert(1)</script>"
    page.moment["vehicles"]["van-1"]["text"] = "<script>alert(1)</script>"
    tab = opened("?tab=orders")
    asked: list[str] = []
    tab.on("dialog", lambda dialog: (asked.append(dialog.message), dialog.dismiss()))
    tab.locator("tr[data-id^='<img'] td >> nth=1").click()
    tab.wait_for_selector("#card-body .small")
    assert tab.inner_text("#card-title") == name
    assert "<b>bold</b>" in tab.inner_text("#card-body")
    tab.click("#banner [data-more]")
    tab.reload()
    tab.wait_for_selector("#card-body .small")
    assert tab.inner_text("#card-title") == name
    assert asked == []
    assert tab.locator("#card-body img, #banner script, td b").count() == 0


@pytest.mark.long
@pytest.mark.parametrize("width", [1440, 390])
def test_nothing_overlaps_sticks_out_or_breaks(opened, width: int):
    """Panels, texts and figures keep to their places."""
    tab = opened("#van/van-1", width)
    tab.wait_for_selector("#card-body .timeline")
    assert geometry_faults(tab) == []
    tab.click("#card-close")
    assert geometry_faults(tab) == []


def serious(tab: Any, part: str = "body", **options: Any) -> list[str]:
    """What axe finds in a part of the page that is serious or critical."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    answer = axe.Axe().run(tab, part, {"resultTypes": ["violations"], **options}).response
    assert len(answer["passes"]) > (20 if part == "body" and not options else 0)
    return [
        f"{one['id']}: {node['html'][:120]} {node['any'][:1]}"
        for one in answer["violations"]
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"][:3]
    ]


@pytest.mark.long
def test_everything_can_be_done_by_keyboard(opened):
    """Skip link, tabs, rows, the line between tables and map."""
    tab = opened()
    tab.keyboard.press("Tab")
    assert tab.evaluate("document.activeElement.className") == "skip"
    tab.focus("#tab-vehicles")
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate("document.activeElement.id") == "tab-roads"
    tab.focus("#pane-roads table")
    tab.keyboard.press("ArrowDown")
    tab.keyboard.press("Enter")
    wanted = rows(tab)[1]
    assert tab.url.endswith(f"#road/{wanted}")
    tab.focus("#splitter")
    before = tab.locator("#left").bounding_box()["width"]
    tab.keyboard.press("ArrowRight")
    assert tab.locator("#left").bounding_box()["width"] > before


@pytest.mark.long
def test_exports_lead_to_what_is_shown(opened):
    """The table as CSV, the map as PNG, a report of the day."""
    tab = opened("?tab=roads")
    assert tab.get_attribute("#export-table", "href") == "api/export/roads.csv"
    tab.click("#export summary")
    with tab.expect_download() as download:
        tab.click("#export-map")
    assert download.value.suggested_filename.endswith("Z.png")
    assert Path(download.value.path()).read_bytes()[:4] == b"\x89PNG"
    assert tab.text_content("#export-table") == "Whole table, CSV"
    with tab.expect_popup() as report:
        tab.click("#reports button")
    assert re.search(r"/report\?day=\d{4}-\d\d-\d\d$", report.value.url)
    report.value.close()


@pytest.mark.long
def test_rows_are_saved_as_they_are_shown(opened):
    """Filtered and sorted; where no table is open, nothing is offered."""
    tab = opened("?tab=roads")
    tab.fill("#filter", "turbulent")
    tab.click("#pane-roads button[data-sort=name]")
    tab.click("#pane-roads button[data-sort=name]")
    shown = rows(tab)
    tab.click("#export summary")
    with tab.expect_download() as download:
        tab.click("#export-shown")
    head, *saved = Path(download.value.path()).read_text().splitlines()
    assert head == "id"
    assert len(saved) > 1
    assert saved[: len(shown)] == shown
    tab.click("#tab-energy")
    assert not tab.is_visible("#export-shown")


@pytest.mark.long
def test_boxes_in_pictures_are_switched_off_and_stay_off(opened):
    """On a unit's card and in the grid alike, also after a reload."""
    tab = opened("?tab=rsus#rsu/rsu-1")
    still = "/api/rsus/rsu-1/still"
    with tab.expect_request(lambda request: still in request.url) as asked:
        tab.wait_for_selector("figure.picture img")
    assert asked.value.url.endswith(still)
    tab.uncheck("figure.picture [data-boxes]")
    for again in (lambda: None, tab.reload):
        with tab.expect_request(lambda request: request.url.endswith("/still?boxes=false")):
            again()
    tab.click("#tab-cameras")
    assert not tab.is_checked("#pane-cameras [data-boxes]")
    with tab.expect_request(lambda request: "/still" in request.url) as asked:
        pass
    assert asked.value.url.endswith("/still?boxes=false")


REACHED = """(selector) => {
  // Whether a reader can bring it into the window, and point at it there.
  const node = [...document.querySelectorAll(selector)].find((one) => one.getClientRects().length);
  if (!node) return `no ${selector}`;
  node.scrollIntoView({block: "center"});
  const box = node.getBoundingClientRect();
  if (box.left < -1 || box.right > innerWidth + 1) return `${selector} sticks out`;
  const hit = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
  return hit && (node.contains(hit) || hit.contains(node)) ? null : `${selector} is covered`;
}"""


@pytest.mark.long
@pytest.mark.parametrize(("width", "height"), [(640, 400), (320, 256)])
def test_a_low_window_scrolls_to_everything(browser: Any, page: FakePage, width: int, height: int):
    """As a page at 200 % or 400 %: tables have a height and scroll, and nothing is out of reach."""
    context = browser.new_context(viewport={"width": width, "height": height})
    tab = open_page(context, page)
    rows = tab.evaluate("document.querySelector('.scroller').clientHeight")
    assert rows >= 100
    assert tab.evaluate(
        "(() => { const s = document.querySelector('.scroller'); s.scrollTop = 400;"
        " return s.scrollTop > 100; })()"
    )
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    parts = (
        *(
            "#search",
            "#control summary",
            "#export summary",
            "#theme",
            "#banner a",
            "#glance button",
        ),
        *(".map-buttons button", "#filter", "tbody tr[data-id]", "#time-slider", "#time-moment"),
        *("#time-live", "#time-forth", "#time-span"),
    )
    assert [fault for part in parts if (fault := tab.evaluate(REACHED, part))] == []
    tab.evaluate("document.querySelector('tbody tr[data-id]').click()")
    tab.wait_for_selector("#card-body .timeline")
    assert tab.evaluate(REACHED, "#card-body section:last-of-type h3") is None
    assert tab.evaluate(REACHED, "#card-close") is None
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert tab.faults == []
    context.close()


@pytest.mark.long
def test_a_picture_that_is_none_of_now_is_grey_and_tells_its_age(opened, page):
    """That of a camera that has stopped, which its unit sends again and again; a new one is not."""
    page.taken = city.T0 - 210_000
    tab = opened("?tab=cameras")
    tab.wait_for_selector("figure.stale img")
    assert "grayscale" in tab.evaluate(
        "getComputedStyle(document.querySelector('.stale img')).filter"
    )
    told = tab.inner_text("figure.stale .age")
    assert re.fullmatch(r"Old: of 11:03, 3\smin \d+\ss ago", told), told
    page.taken = None
    until(tab, "!document.querySelector('figure[data-picture].stale')")


@pytest.mark.long
def test_colours_follow_the_system_until_one_is_chosen(opened):
    """The choice is kept."""
    tab = opened(theme="dark")
    assert tab.get_attribute("html", "data-theme") == "dark"
    tab.click("#theme")
    assert tab.get_attribute("html", "data-theme") == "light"
    tab.reload()
    assert tab.get_attribute("html", "data-theme") == "light"


@pytest.mark.long
def test_a_moment_is_written_in_24_hours_and_none_stands_beside_now(opened):
    """In the page's zone; what is no moment is refused in words."""
    tab = opened()
    field = tab.locator("#time-moment")
    until(tab, "!document.getElementById('time-moment').disabled")
    assert field.input_value() == ""
    field.fill("2026-11-18 08:15")
    field.press("Enter")
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    assert tab.inner_text("#clock") == "08:15:00"
    field.fill("eight")
    field.press("Enter")
    assert "2026-11-18 08:15:00" in field.evaluate("(node) => node.validationMessage")
    tab.click("#time-live")
    until(tab, "document.getElementById('badge').textContent === 'Live'")
    until(tab, "document.getElementById('time-moment').value === ''")


@pytest.mark.long
def test_a_moment_that_is_not_kept_is_refused_and_none_takes_its_place(opened, page: FakePage):
    """Before the first, yet to come, and in the address: what is shown stays, and is said."""
    tab = opened()
    field = tab.locator("#time-moment")
    until(tab, "!document.getElementById('time-moment').disabled")
    for text, words in (
        ("2026-11-01 14:00", "Nothing is kept of Sun 1 Nov 2026, 14:00:00 UTC"),
        ("2027-01-01 00:00", "is yet to come"),
    ):
        field.fill(text)
        field.press("Enter")
        until(tab, f"document.getElementById('banner').innerText.includes({words!r})")
        told = tab.inner_text("#banner")
        assert "kept from Tue 17 Nov 2026, 11:06:40 to Wed 18 Nov 2026, 11:06:40 UTC" in told
        assert "Shown is still the present" in told
        assert tab.inner_text("#badge") == "Live"
    assert not any("/api/at" in asked for asked in page.asked)
    field.fill("2026-11-18 08:15")
    field.press("Enter")
    until(tab, "document.getElementById('badge').textContent === 'Past'")
    assert "is kept" not in tab.inner_text("#banner")
    tab.goto(page.url + "?t=1700000000000")
    until(tab, "document.getElementById('banner').innerText.includes('Nothing is kept of')")
    assert tab.inner_text("#badge") == "Live"
    assert "t=" not in tab.url


@pytest.mark.long
def test_a_table_that_is_cut_says_where_the_others_are(opened, page: FakePage):
    """The server lists the newest 200 cycles; fewer are all."""
    tab = opened("?tab=cycles")
    assert not tab.is_visible("#shown-more")
    row = page.moment["cycles"]["1"]
    page.send(set={"cycles": {str(n): dict(row) for n in range(121, 201)}})
    tab.wait_for_selector("#shown-more:not([hidden])")
    assert "move the time bar" in tab.inner_text("#shown-more")
    tab.click("#tab-roads")
    assert not tab.is_visible("#shown-more")


@pytest.mark.long
def test_tabs_out_of_sight_are_pointed_at(opened):
    """On a phone, on the side where there are more."""
    tab = opened("", 390)
    until(tab, "document.getElementById('tabs').dataset.more === 'right'")
    tab.evaluate("document.getElementById('tabs').scrollLeft = 1e4")
    until(tab, "document.getElementById('tabs').dataset.more === 'left'")


ADDRESSES = ("#van/van-1", f"#road/{ROAD}", "#rsu/rsu-5", "#order/o-3", "#cycle/119", "#alarm/a-1")
LOOKED_AT: dict[str, dict[int, dict[str, Any]]] = {
    "light": {1440: {}, 390: {"rules": {"color-contrast": {"enabled": False}}}},
    "dark": {1440: {"runOnly": ["color-contrast"]}},
}
"""Widths at which axe looks, and for what: a theme changes colours only, a width all but them."""


@pytest.mark.long
@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.nightly)])
def test_each_tab_and_card_keeps_its_place_and_is_accessible(opened, theme: str):
    """At four widths, in both themes: geometry, and axe."""
    tab = opened(theme=theme)

    def look(what: str, part: str) -> None:
        for width, height in SIZES.items():
            tab.set_viewport_size({"width": width, "height": height})
            assert geometry_faults(tab) == [], (what, width)
            if width in LOOKED_AT[theme]:
                assert serious(tab, part, **LOOKED_AT[theme][width]) == [], (what, width)

    look("what is always there", "body")

    for name in TABS:
        tab.click(f"#tab-{name}")
        if name == "energy":
            tab.wait_for_selector("#pane-energy rect.drag")
        look(name, "#left")
    for address in ADDRESSES:
        tab.evaluate("(hash) => { location.hash = hash; }", address)
        wanted = address.split("/")[1]
        until(
            tab,
            f"document.getElementById('card-body').childElementCount && "
            f"decodeURIComponent(location.hash).endsWith('{wanted}')",
        )
        look(address, "#card")


@pytest.mark.nightly
def test_ten_thousand_rows_scroll_smoothly(browser: Any):
    """Only rows in view are drawn, and a change of a hundred costs little."""
    net = city.network(120)
    with FakePage(net, city.moment(net, vans=10_000, rsus=5, orders=10)) as running:
        context = browser.new_context(viewport={"width": 1440, "height": 900})
        tab = open_page(context, running)
        until(tab, "document.querySelector('table').getAttribute('aria-rowcount') === '10001'")
        assert len(rows(tab)) < 60
        tab.focus("#pane-vehicles table")
        tab.keyboard.press("End")
        until(tab, "!!document.querySelector('tr[data-id=van-10000]')")
        slowest = tab.evaluate(SCROLLED)
        assert slowest < 100, slowest
        context.close()


SCROLLED = """async () => {
  // The work of one step of scrolling, ms; the median of many, as others use the machine too.
  const box = document.querySelector("#pane-vehicles .scroller");
  const spent = [];
  for (let i = 0; i < 60; i += 1) {
    const begin = performance.now();
    box.scrollTop = i * 4000;
    box.dispatchEvent(new Event("scroll"));
    box.getBoundingClientRect();
    spent.push(performance.now() - begin);
    await new Promise(requestAnimationFrame);
  }
  return spent.sort((a, b) => a - b)[30];
}"""


@pytest.mark.long
def test_a_silent_server_is_told_within_five_seconds(opened, page: FakePage):
    """Its connection stays open and nothing comes any more."""
    tab = opened()
    page.silent.set()
    until(tab, "document.getElementById('banner').innerText.includes('is lost')", timeout_s=6)
    page.silent.clear()
    until(tab, "document.getElementById('badge').textContent === 'Live'")
    tab.faults.clear()


@pytest.mark.long
def test_cameras_are_asked_for_pictures_only_while_in_view(opened, page: FakePage):
    """Of those chosen the ones that are scrolled to, and none once another tab is open."""
    tab = opened("?tab=cameras", 1024)
    tab.click(".choose summary")
    for box in tab.locator(".choice input").all()[6:30]:
        box.check()
    tab.click(".choose summary")
    assert tab.locator(".camera").count() == 30
    until(tab, "document.querySelectorAll('.camera img:not([hidden])').length > 5")
    asked = {path for path in page.asked if path.endswith("/still")}
    assert len(asked) < 24
    tab.click("#tab-roads")
    before = settled(page)
    assert settled(page) == before
    tab.reload()
    tab.click("#tab-cameras")
    assert tab.locator(".camera").count() == 30


def settled(page: FakePage) -> int:
    """How many pictures were asked for until a second from now."""
    time.sleep(1.0)
    return sum(path.endswith("/still") for path in page.asked)
