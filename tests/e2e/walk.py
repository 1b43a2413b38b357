"""A walk over the operator's page of running daemons: what is clicked, and what it must do."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from tests.dashboard.web.browser import SIZES, TABS, geometry_faults, until

TIMEOUT_MS = 90_000
"""Chromium draws without a GPU, beside two cameras' detectors."""


class Walk:
    """A browser of one width on the page, whose script errors are kept.

    Args:
        browser: playwright's.
        url: of the page.
        width: of the screen, px; one of `SIZES`.
        vans: the whole fleet.
    """

    def __init__(self, browser: Any, url: str, width: int, vans: set[str]) -> None:
        self.url, self.vans = url, vans
        self.faults: list[str] = []
        size = {"width": width, "height": SIZES[width]}
        self.context = browser.new_context(viewport=size, locale="en-GB", accept_downloads=True)
        self.tab = self._tab(url)

    def _tab(self, url: str) -> Any:
        tab = self.context.new_page()
        tab.set_default_timeout(TIMEOUT_MS)
        tab.on("pageerror", lambda error: self.faults.append(str(error)))
        tab.goto(url)
        return tab

    def walk(self) -> None:
        """All of it; then nothing has gone wrong in the browser."""
        self.tab.wait_for_selector("html[data-map]", state="attached")
        for part in (
            self.tables,
            self.cards,
            self.glance,
            self.energy,
            self.alarms,
            self.past,
            self.only_looking,
            self.exports,
            self.cameras,
            self.manners,
            self.scene,
        ):
            part()
        assert self.faults == []
        self.context.close()

    def placed(self, where: str) -> None:
        """No panel over another, nothing sticks out or is broken."""
        found = geometry_faults(self.tab)
        assert not found, f"{where}: {found}"

    def open(self, name: str) -> None:
        """A tab; where the screen is narrow, a card lies in front of it."""
        if not self.tab.is_visible(f"#tab-{name}"):
            self.tab.click("#card-close")
        self.tab.click(f"#tab-{name}")

    def rows(self) -> list[str]:
        """Ids of the open table's rows, from the top."""
        found: list[str] = self.tab.locator(".pane:not([hidden]) tr[data-id]").evaluate_all(
            "rows => rows.map((row) => row.dataset.id)"
        )
        return found

    def tables(self) -> None:
        """Each tab; the whole fleet, reported or by plan; sorted and filtered."""
        tab = self.tab
        for name in TABS:
            self.open(name)
            assert tab.get_attribute(f"#tab-{name}", "aria-selected") == "true"
            assert tab.is_visible(f"#pane-{name}")
            self.placed(name)
        self.open("vehicles")
        all_of_them = f"{len(self.vans)} rows"
        until(tab, f"document.getElementById('shown').textContent === '{all_of_them}'")
        shown = self.rows()
        assert set(shown) <= self.vans
        assert tab.locator("#pane-vehicles tr[data-id] svg.swatch").count() == len(shown)
        first = set()
        for _ in range(2):
            tab.click("#pane-vehicles button[data-sort=id]")
            first.add(self.rows()[0])
        assert first == {min(self.vans), max(self.vans)}
        tab.fill("#filter", "van-01")
        assert self.rows() == ["van-01"]
        assert tab.inner_text("#shown") == f"1 of {len(self.vans)} rows"
        tab.fill("#filter", "")

    def cards(self) -> None:
        """By click, by `/`, by address and after a reload."""
        tab = self.tab
        tab.click("#pane-vehicles tr[data-id=van-01] td >> nth=1")
        self.card("van-01", "#van/van-01", ("Plan", "Energy", "Why this route", "Why this platoon"))
        assert tab.locator("#card-body .timeline").count() == 1
        tab.click("#card-close")
        assert tab.locator("#card").is_hidden()
        tab.keyboard.press("/")
        tab.keyboard.type("rsu-west")
        tab.keyboard.press("Enter")
        self.card("rsu-west", "#rsu/rsu-west", ("Calibration", "Reception"))
        until(tab, "document.querySelector('#card-body figure.picture img')?.naturalWidth > 300")
        tab.evaluate("location.hash = '#road/avenue_east'")
        for _ in range(2):
            self.card("avenue_east", "#road/avenue_east", ("Features", "The last hour"))
            # Minutes of the hour are stored as they end.
            until(
                tab,
                "document.querySelectorAll('#card-body figure[data-key] svg').length >= 5",
                90.0,
            )
            tab.reload()
        self.open("cycles")
        tab.click("#pane-cycles tr[data-id] >> nth=0")
        self.card("", "#cycle/", ())
        self.open("orders")
        tab.click("#pane-orders tr[data-id] >> nth=0")
        self.card("", "#order/", ())

    def card(self, name: str, address: str, sections: tuple[str, ...]) -> None:
        """The open card is this subject's, with these sections."""
        self.tab.wait_for_selector("#card-body .lead, #card-body .tiles")
        assert address in self.tab.url
        for title in sections:
            heading = self.tab.locator("#card-body").get_by_role("heading", name=title, exact=True)
            heading.wait_for(state="attached")
        assert name in self.tab.inner_text("#card")
        self.placed(address)

    def glance(self) -> None:
        """What the banner tells is told in the title; a figure at a glance leads to its rows."""
        tab = self.tab
        told = re.match(r"\(([\d,]+)\) ", tab.title())
        assert bool(told) == tab.is_visible("#banner[role=alert]")
        tab.click("#glance [data-tab=rsus] >> nth=0")
        assert tab.get_attribute("#tab-rsus", "aria-selected") == "true"

    def energy(self) -> None:
        """Three sums with their parts, bars by hour and by day, all summed up."""
        tab = self.tab
        self.open("energy")
        pane = tab.locator("#pane-energy")
        for title in ("Today", "This week", "Since the start"):
            pane.get_by_role("heading", name=title).first.wait_for()
        pane.locator("figure[data-key=sum] svg").wait_for()
        assert pane.locator(".headline", has_text="kWh").count() >= 3
        text = pane.inner_text()
        for part in ("distance", "drag", "acceleration", "CO", "platoon"):
            assert part in text.lower() or part in text, part
        self.placed("energy")

    def alarms(self) -> None:
        """Those there are, or that nothing is wrong; one opens its card."""
        tab = self.tab
        self.open("alarms")
        if not self.rows():
            assert "nothing is wrong" in tab.inner_text("#pane-alarms")
            return
        tab.click("#pane-alarms tr[data-id] >> nth=0")
        self.card("", "#alarm/", ())

    def past(self) -> None:
        """The first moment that is kept, played on, and live again; a card follows."""
        tab = self.tab
        tab.evaluate("location.hash = '#van/van-01'")
        tab.focus("#time-slider")
        tab.keyboard.press("Home")
        until(tab, "document.documentElement.dataset.time === 'past'")
        assert tab.inner_text("#badge").lower() == "past"
        assert "t=" in tab.url
        begin = float(tab.url.partition("t=")[2].partition("#")[0].partition("&")[0])
        self.placed("past")
        tab.select_option("#time-rate", "60")
        tab.click("#time-play")
        moment = "Number(new URLSearchParams(location.search).get('t'))"
        live = "document.documentElement.dataset.time === 'live'"
        until(tab, f"{live} || {moment} > {begin + 5000}")
        if tab.get_attribute("html", "data-time") == "past":
            tab.click("#time-live")
        until(tab, live)

    def only_looking(self) -> None:
        """Without `--allow-control` no action is offered."""
        assert self.tab.is_hidden("#control")
        assert self.tab.locator("[data-action]:visible").count() == 0

    def exports(self) -> None:
        """The map as a picture, rows and a whole table as CSV, a day's report."""
        tab = self.tab
        self.open("vehicles")
        assert self._downloaded("#export-map")[:4] == b"\x89PNG"
        assert len(self._downloaded("#export-shown").splitlines()) == 1 + len(self.vans)
        assert len(self._downloaded("#export-table").splitlines()) == 1 + len(self.vans)
        tab.click("#export summary")
        with tab.expect_popup() as opened:
            tab.click("#reports button")
        report = opened.value
        report.wait_for_load_state()
        assert "kWh" in report.inner_text("body")
        report.close()
        tab.keyboard.press("Escape")

    def _downloaded(self, button: str) -> bytes:
        tab = self.tab
        tab.evaluate("document.getElementById('export').open = true")
        with tab.expect_download() as download:
            tab.click(button)
        tab.evaluate("document.getElementById('export').open = false")
        return Path(download.value.path()).read_bytes()

    def cameras(self) -> None:
        """Pictures of those that are chosen, with boxes or without."""
        tab = self.tab
        self.open("cameras")
        pictures = "[...document.querySelectorAll('#pane-cameras .cameras img')]"
        until(tab, f"{pictures}.length === 2 && {pictures}.every((one) => one.naturalWidth > 300)")
        tab.click("#pane-cameras details.choose summary")
        tab.uncheck("#pane-cameras .choice input >> nth=0")
        until(tab, f"{pictures}.length === 1")
        tab.check("#pane-cameras .choice input >> nth=0")
        until(tab, f"{pictures}.length === 2")
        self.placed("cameras")

    def manners(self) -> None:
        """Title, clock with its zone, colours by choice, everything by keyboard."""
        tab = self.tab
        assert tab.title().endswith("Slipstream")
        assert re.fullmatch(r"\d\d:\d\d:\d\d", tab.inner_text("#clock"))
        assert tab.text_content("#zone")
        before = tab.get_attribute("html", "data-theme")
        while tab.get_attribute("html", "data-theme") == before:
            tab.click("#theme")
        self.placed("the other colours")
        tab.focus("#tab-cameras")
        tab.keyboard.press("ArrowRight")
        assert tab.evaluate("document.activeElement.id") == "tab-energy"
        tab.focus("#map canvas")
        tab.keyboard.press("+")

    def scene(self) -> None:
        """One click leads to the same subject in 3D, and one back."""
        tab = self.tab
        tab.evaluate("location.hash = '#van/van-01'")
        until(tab, "document.getElementById('scene').href.includes('select=van')")
        tab.click("#scene")
        tab.wait_for_selector("canvas[data-engine]")
        tab.get_by_text("van-01").first.wait_for()
        back = tab.locator("a[href*='#van/van-01']").first
        back.wait_for()
        assert back.get_attribute("href").startswith(self.url.rstrip("/"))
