"""The 3D view in a real browser, by geometry: panels, labels that do not overlap, clicks."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from dashboard.live import Snapshot
from dashboard.page import Page
from dashboard.scene import geometry
from dashboard.scene.labelling import HEIGHT_PX, width_px
from dashboard.selection import Selection
from dashboard.settings import DashboardSettings
from dashboard.web.pictures import Pictures
from slipstream.bus import free_port

pytestmark = [
    pytest.mark.process,
    pytest.mark.long,
    # The view goes on after the browser of a test has gone.
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection:UserWarning"),
]
S = 1_000_000_000
DRAWN = "window.__viserTestpoints?.rendererInfo.render.triangles > 20"
LABELS = """() => {
  const context = document.createElement("canvas").getContext("2d");
  context.font = "12px " + getComputedStyle(document.body).fontFamily;
  const nodes = window.__viserSceneTree.getState(), shown = [];
  for (const [name, node] of Object.entries(nodes)) {
    if (node?.message?.type !== "LabelMessage" || node.visibility === false) continue;
    const camera = window.__viserMutable.camera;
    const pose = window.__viserMutable.nodePoseData[name];
    const place = camera.position.clone().fromArray(pose.position);
    const at = place.applyMatrix4(window.__viserMutable.nodeRefFromName["/labels"].matrixWorld)
      .project(camera);
    const canvas = window.__viserMutable.canvas.getBoundingClientRect();
    const text = node.message.props.text;
    shown.push({text, x: (at.x + 1) / 2 * canvas.width, y: (1 - at.y) / 2 * canvas.height,
                width: context.measureText(text).width});
  }
  return shown;
}"""


BOXES = """(selector) => [...document.querySelectorAll(selector)]
  .map((node) => node.getBoundingClientRect())
  .map(({x, y, width, height}) => ({x, y, width, height}))"""


def _boxes(page: Any, selector: str) -> list[dict[str, float]]:
    """Where all that match are drawn, px, found and measured in one call: a block is drawn anew by
    each change, and a node found before has no size any more.
    """
    boxes: list[dict[str, float]] = page.evaluate(BOXES, selector)
    return [box for box in boxes if box["height"] > 0]


@dataclass
class View:
    """A served 3D view whose data the test may change."""

    page: Page
    address: str
    snapshot: Callable[[], Snapshot]


@pytest.fixture(scope="module")
def view(world) -> Iterator[View]:
    """The demo's two vans behind each other, a calm road and a turbulent one; made anew each
    0.3 s."""
    began_ns = time.time_ns()
    stopping = threading.Event()
    settings = DashboardSettings(scene_port=free_port(), database_url=None)

    def snapshot() -> Snapshot:
        now_ns = time.time_ns()
        # By whole seconds, so that a label's text does not change with each picture.
        states = [
            world.state(name, now_ns // S * S, y_e=y_e)
            for name, y_e in (("avenue_east", 1), ("avenue_west", 0))
        ]
        return Snapshot(
            states={(state.segment, state.rsu): state for state in states},
            rsus={state.rsu: world.health(state.segment, now_ns // S * S) for state in states},
            plans={
                van: world.plan(van, 9, began_ns - behind_s * S)
                for van, behind_s in (("van-a", 95), ("van-b", 93))
            },
            cycles=tuple(world.cycle(number, began_ns) for number in range(1, 10)),
            dispatcher=world.dispatcher(now_ns),
        )

    shown = View(
        Page(
            settings,
            world.network,
            stopping,
            Pictures(),
            "http://operator.example",
            ("depot",),
        ),
        f"http://127.0.0.1:{settings.scene_port}",
        snapshot,
    )

    class Now:
        def snapshot(self) -> Snapshot:
            return shown.snapshot()

    def serve() -> None:
        while not stopping.wait(0.3):
            shown.page.show(Now(), time.time_ns())

    thread = threading.Thread(target=serve)
    thread.start()
    yield shown
    stopping.set()
    thread.join()
    shown.page.close()


@pytest.fixture
def opened(browser, view) -> Iterator[Callable[..., Any]]:
    """Opens the view in a window of a width, px; all windows are gone at a test's end."""
    with ExitStack() as pages:

        def page(width: int, query: str = "", scheme: str = "light") -> Any:
            page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
            pages.callback(page.close)
            page.goto(f"{view.address}/{query}")
            page.wait_for_function(DRAWN, timeout=90_000)
            page.get_by_text("Traffic is calm on 1 of 2").wait_for(timeout=30_000)
            return page

        yield page
    assert _until(lambda: view.page.clients() == 0)


def _one(view: View) -> Any:
    """The server's side of the only browser."""
    assert _until(lambda: len(view.page._browsers) == 1)
    (one,) = view.page._browsers.values()
    return one


def _until(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 120
    while not (holds := condition()) and time.monotonic() < deadline:
        time.sleep(0.2)
    return holds


def test_the_panel_covers_nothing(opened, view):
    """Map and panel stand side by side, figures are one line high, no developer controls."""
    width = 1024
    page = opened(width, "?select=van/van-a")
    page.get_by_text("Vehicle van-a").wait_for(timeout=30_000)
    (canvas,) = _boxes(page, "canvas[data-engine]")
    boxes = _boxes(page, ".sl")
    assert len(boxes) >= 3
    for box in boxes:
        assert box["x"] >= canvas["x"] + canvas["width"] - 1
        assert box["x"] + box["width"] <= width
    for upper, lower in pairwise(boxes):
        assert lower["y"] >= upper["y"] + upper["height"] - 1
    assert canvas["width"] > width / 2
    (head,) = _boxes(page, ".sl .head")
    assert 0 <= head["y"] < 200
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    figures = _boxes(page, ".sl .facts .n")
    assert len(figures) >= 3
    assert all(box["height"] < 30 for box in figures)
    for icon in ("adjustments", "share"):
        assert not page.locator(f".tabler-icon-{icon}").first.is_visible()


def test_no_two_labels_overlap_in_the_browser(opened, view):
    """By the browser's own camera and font; and no label is wider than it is thought to be."""
    page = opened(1920)
    shown: list[dict[str, Any]] = []

    def labelled() -> bool:
        shown[:] = page.evaluate(LABELS)
        return {"van-a, by plan", "Depot"} <= {label["text"] for label in shown}

    assert _until(labelled), shown
    # Two looks, so that what was about to move has moved.
    time.sleep(1)
    shown = page.evaluate(LABELS)
    for label in shown:
        assert label["width"] + 4 <= width_px(label["text"]), label
    for index, one in enumerate(shown):
        for other in shown[index + 1 :]:
            apart_x = abs(one["x"] - other["x"]) - (one["width"] + other["width"]) / 2
            apart_y = abs(one["y"] - other["y"]) - HEIGHT_PX
            assert max(apart_x, apart_y) > 0, (one, other)


def _pixel(view: View, kind: str, name: str) -> np.ndarray:
    """Where the first browser draws a mark, px."""
    one = _one(view)
    eye = one.viewer.eye()
    if kind == "road":
        # Not in its middle, beside which its camera stands.
        road_map = view.page._map
        place, _ = geometry.point_at(road_map.line(name), 0.2)
        return eye.pixels(road_map.canvas.positions(place, 0.0))[0][0]
    mark = next(mark for mark in one._drawn.marks if (mark.kind, mark.id) == (kind, name))
    return eye.pixels(np.array([mark.position]))[0][0]


def test_a_click_selects(opened, view):
    """A click on a vehicle, a camera, a road and beside them all changes the card, for this browser
    alone, with its link to the operator's page."""
    page = opened(1440)
    one = _one(view)
    assert _until(lambda: one._drawn is not None and "Click a vehicle" in one._sent)
    time.sleep(1)
    for kind, name, words in (
        ("rsu", "rsu-avenue_east", "Roadside unit rsu-avenue_east"),
        ("road", "avenue_west", "Road avenue_west"),
        ("van", "van-b", "Vehicle van-b"),
    ):
        x, y = _pixel(view, kind, name)
        page.mouse.click(x, y + (2 if kind != "road" else 0))
        page.get_by_text(words).wait_for(timeout=30_000)
        link = page.get_by_text("Open on the operator's page").get_attribute("href")
        assert link == f"http://operator.example/#{kind}/{name}"
        assert one.viewer.selection == Selection(kind, name)
        wanted = {"rsu-avenue_east"} if kind == "rsu" else set()
        assert _until(lambda wanted=wanted: view.page._looks.keys() == wanted)
    other = opened(1024)
    other.get_by_text("Click a vehicle, a road or a camera").wait_for(timeout=30_000)
    other.close()
    page.mouse.click(20, 760)
    page.get_by_text("Click a vehicle, a road or a camera").wait_for(timeout=30_000)


def test_buttons_lead_the_camera(opened, view):
    """The whole map, from above, and the selection from near by; an unknown name harms nothing."""
    page = opened(1440, "?select=van/nobody")
    page.get_by_text("no such vehicle is known").wait_for(timeout=30_000)
    one = _one(view)

    def ahead() -> np.ndarray:
        return one.viewer.eye().turn[:, 2]

    page.get_by_role("button", name="From above").click()
    assert _until(lambda: ahead()[2] < -0.99)
    page.get_by_role("button", name="Whole map").click()
    assert _until(lambda: -0.9 < ahead()[2] < -0.5)
    far = one.viewer.eye().position[2]
    one.viewer.select(Selection("rsu", "rsu-avenue_east"))
    page.get_by_role("button", name="Selection").click()
    assert _until(lambda: one.viewer.eye().position[2] < far / 1.5)


def _compass(page: Any) -> tuple[float, float]:
    """Degrees that the arrow is turned clockwise, and the metres a pixel by the bar."""
    return tuple(
        page.evaluate("""() => {
          const [arrow, bar] = document.getElementById("sl-scale").children;
          const [number, unit] = bar.textContent.split(" ");
          return [Number(arrow.style.transform.match(/-?[0-9.]+/)[0]),
                  number * (unit === "km" ? 1000 : 1) / bar.offsetWidth];
        }""")
    )


def test_north_and_scale_follow_the_camera(opened, view):
    """Arrow and bar stay in the map's corner; both agree with the server's view of the camera."""
    page = opened(1440)
    one = _one(view)
    page.get_by_role("button", name="From above").click()
    assert _until(lambda: one.viewer.eye().turn[2, 2] < -0.99)

    def agrees() -> bool:
        eye, canvas = one.viewer.eye(), view.page._map.canvas
        metres_a_pixel = eye.position[2] / eye.focal_px / canvas.scale
        turn, shown = _compass(page)
        right = eye.turn[:, 0]
        away = turn - np.degrees(np.arctan2(right[1], right[0]))
        return abs((away + 180) % 360 - 180) < 2 and abs(shown / metres_a_pixel - 1) < 0.05

    assert _until(agrees), (_compass(page), one.viewer.eye())
    before = _compass(page)
    client = one._client
    # The point that it looks at moves with the position: set after it.
    client.camera.position = (3.0, 2.0, 3.0)
    client.camera.look_at = (0.0, 0.0, 0.0)
    assert _until(lambda: abs(_compass(page)[0] - before[0]) > 20)
    (box,), (canvas,) = _boxes(page, "#sl-scale"), _boxes(page, "canvas[data-engine]")
    assert canvas["x"] < box["x"]
    assert box["x"] + box["width"] < canvas["x"] + 250
    assert canvas["height"] - 80 < box["y"] < canvas["height"] - box["height"]


def test_a_phone_sees_map_and_panel(opened, view):
    """The panel is below the map, in the scheme of the browser; collapsed it makes room."""
    page = opened(390, scheme="dark")
    root = "getComputedStyle(document.documentElement).colorScheme"
    assert page.evaluate(root) == "dark"

    def seen() -> list[dict[str, float]]:
        return _boxes(page, "canvas[data-engine], .sl .head")

    def apart() -> bool:
        boxes = sorted(seen(), key=lambda box: box["y"])
        if len(boxes) != 2:
            return False
        canvas, head = boxes
        return canvas["height"] > 250 and head["y"] >= canvas["y"] + canvas["height"]

    assert _until(apart), seen()
    # Between two drawings there is none for a moment.
    assert _until(lambda: [box["x"] < 40 for box in _boxes(page, ".sl .head")] == [True])
    page.get_by_text("Slipstream in 3D", exact=True).click()
    canvas = "canvas[data-engine]"
    assert _until(lambda: any(box["height"] > 700 for box in _boxes(page, canvas)))
    assert page.locator("#sl-scale").is_visible()
