"""What tests of the page in a browser share: opening it, and what its geometry must be."""

from __future__ import annotations

import time
from typing import Any

from tests.dashboard.web.pages import city
from tests.dashboard.web.pages.fake import FakePage

SIZES = {1920: 1080, 1440: 900, 1024: 768, 390: 844}
"""Widths and heights of screens, px."""
TABS = ("vehicles", "roads", "rsus", "orders", "cycles", "alarms", "cameras", "energy")

OUTSIDE = """() => {
  // What is wider than its place without a bar to scroll by.
  const found = [];
  if (document.documentElement.scrollWidth > innerWidth) found.push("the page");
  for (const node of document.querySelectorAll("body *")) {
    const style = getComputedStyle(node);
    if (node.closest("[hidden], svg, .city-map, .skip") || !node.getClientRects().length) continue;
    const box = node.getBoundingClientRect();
    if (style.position === "absolute" && style.clipPath !== "none") continue;
    const clips = "#glance ul, #tabs, .wide, .rows td";
    if (box.right > innerWidth + 1 && !node.parentElement.closest(clips))
      found.push(`${node.tagName}#${node.id}.${node.className} to ${box.right}`);
  }
  return found;
}"""

BROKEN = """() => [...document.querySelectorAll(".num")].filter((node) => {
  if (!node.getClientRects().length || !node.textContent.trim()) return false;
  const range = document.createRange();
  range.selectNodeContents(node);
  const middles = [...range.getClientRects()].filter((box) => box.width > 0)
    .map((box) => (box.top + box.bottom) / 2);
  return Math.max(...middles) - Math.min(...middles) > 8;
}).map((node) => node.textContent)"""

CUT = """() => [...document.querySelectorAll(".rows td.num span, .tile .value.num, .parts dd.num")]
  .filter((node) => node.getClientRects().length)
  .filter((node) => node.closest("td, div").scrollWidth > node.closest("td, div").clientWidth + 1)
  .map((node) => node.textContent)"""

CROWDED = """() => {
  // Texts at a glance that lie on each other or out of their place.
  const found = [], texts = [];
  for (const node of document.querySelectorAll("#glance :is(.name, .value, .note)")) {
    if (!node.getClientRects().length) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const box = range.getBoundingClientRect(), place = node.closest("li").getBoundingClientRect();
    if (box.right > place.right + 1 || box.bottom > place.bottom + 1)
      found.push(`${node.textContent} out of its place`);
    texts.push([node.textContent, box]);
  }
  texts.forEach(([one, a], i) => texts.slice(i + 1).forEach(([other, b]) => {
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 1 && down > 1) found.push(`${one} over ${other}`);
  }));
  return found;
}"""

PARTS = ("header", "banner", "glance", "left", "map", "card", "timebar")

OVERLAPS = """(ids) => {
  const boxes = ids.map((id) => [id, document.getElementById(id)])
    .filter(([, node]) => node && node.getClientRects().length)
    .map(([id, node]) => [id, node.getBoundingClientRect()]);
  const found = [];
  boxes.forEach(([one, a], i) => boxes.slice(i + 1).forEach(([other, b]) => {
    const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (across > 1 && down > 1) found.push(`${one} over ${other}`);
  }));
  for (const [id, box] of boxes)
    if (box.bottom > innerHeight + 1) found.push(`${id} below the window`);
  return found;
}"""


def open_page(context: Any, page: FakePage, path: str = "") -> Any:
    """The page, with its first moment drawn. Whatever it logs as an error fails the test later."""
    tab = context.new_page()
    # The made-up city has a time of its own.
    tab.add_init_script(f"{{const s={city.T0}-Date.now(),n=Date.now;Date.now=()=>n()+s;}}")
    tab.faults = []
    tab.on("pageerror", lambda error: tab.faults.append(str(error)))
    tab.on("console", lambda said: said.type == "error" and tab.faults.append(said.text))
    tab.goto(page.url + path)
    tab.wait_for_selector("html[data-map]")
    return tab


def until(tab: Any, script: str, timeout_s: float = 30.0) -> None:
    """Waits until an expression is true. Playwright's way needs eval, which the page forbids."""
    deadline = time.monotonic() + timeout_s
    while not tab.evaluate(script):
        assert time.monotonic() < deadline, f"never: {script}"
        time.sleep(0.05)


def geometry_faults(tab: Any) -> list[str]:
    """What lies over something else, sticks out, or breaks inside a figure."""
    return [
        *tab.evaluate(OVERLAPS, list(PARTS)),
        *(f"at a glance: {one}" for one in tab.evaluate(CROWDED)),
        *(f"outside: {one}" for one in tab.evaluate(OUTSIDE)),
        *(f"broken: {one}" for one in tab.evaluate(BROKEN)),
        *(f"cut: {one}" for one in tab.evaluate(CUT)),
    ]
