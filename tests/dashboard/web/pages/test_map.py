"""The operator's map in Chromium: what it draws, what a click finds, how it moves."""

from __future__ import annotations

import base64
import itertools
import math
import struct
from collections.abc import Iterator
from typing import Any

import pytest

from tests.dashboard.web.pages import map_data
from tests.dashboard.web.pages.map_site import OpenMap, map_pages

pytestmark = pytest.mark.process

PIXELS = """([x, y, width, height]) => {
  const canvas = document.querySelector(".map-canvas");
  map._frame();
  return [...canvas.getContext("2d").getImageData(x, y, width, height).data];
}"""
COUNT = """([r, g, b]) => {
  map._frame();
  const canvas = document.querySelector(".map-canvas");
  const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let found = 0;
  for (let i = 0; i < data.length; i += 4) {
    const away = [r, g, b].map((value, part) => Math.abs(data[i + part] - value));
    found += Math.max(...away) < 7;
  }
  return found;
}"""
COLOUR = """(name) => {
  const context = document.createElement("canvas").getContext("2d");
  context.fillStyle = getComputedStyle(document.querySelector(".city-map")).getPropertyValue(name);
  context.fillRect(0, 0, 1, 1);
  return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""


@pytest.fixture(scope="module")
def open_map(browser: Any) -> Iterator[OpenMap]:
    """Opens maps."""
    with map_pages(browser) as pages:
        yield pages


@pytest.fixture(scope="module")
def troy(open_map: OpenMap) -> Any:
    """Troy with six vehicles and what stands around them."""
    network = map_data.troy()
    page = open_map(network, map_data.moment(network, 6, 60, 12, 30))
    page.network = network
    return page


@pytest.fixture
def town(troy: Any) -> Iterator[Any]:
    """Troy as a whole, nothing selected; nothing has gone wrong in it afterwards."""
    troy.evaluate("map.select(null); map.fit(); window.selected.length = 0")
    yield troy
    assert troy.errors == []


@pytest.fixture(scope="module")
def street(open_map: OpenMap) -> Any:
    """Three parallel one-way roads eastwards, one of each flag, and three vehicles."""
    return open_map(STREETS, three_roads(), width=600, height=400)


STREETS: dict[str, Any] = {
    "id": "three",
    "bounds": [0, -150, 500, 150],
    "roads": [
        {
            "id": flag,
            "name": None,
            "shape": [0, y, 250, y, 500, y],
            "length_m": 500,
            "limit_kmh": 50,
            "lanes": 1,
        }
        for flag, y in (("stable", 100), ("turbulent", 0), ("unknown", -100))
    ],
    "depots": [],
}


def three_roads() -> dict[str, Any]:
    """Rows for the three roads."""
    common = {"heading": 90, "state": "driving", "text": "drives", "with": [], "level": "ok"}
    return {
        "vehicles": {
            "a": {**common, "x": 120, "y": 50, "source": "reported", "colour": 0, "at": 0}
            | {"road": "stable", "route": [[0, 1]]},
            "b": {**common, "x": 240, "y": 50, "source": "planned", "colour": 3, "at": 1}
            | {"road": "unknown", "route": [[1, 0], [2, 0]]},
            "<img src=x onerror=fail()>": {**common, "x": 360, "y": 50, "source": "planned"}
            | {"colour": 5, "at": None, "road": None, "route": [], "text": "<b>bold</b>"},
        },
        "roads": {
            flag: {"flag": flag, "kmh": 40, "why": None, "gate": "open", "rsu": None, "stopped": 0}
            for flag in ("stable", "turbulent", "unknown")
        },
        "rsus": {},
        "orders": {},
    }


def pixels(page: Any, x: float, y: float, width: int, height: int) -> list[list[tuple[int, ...]]]:
    """Rows of a part of the canvas, (r, g, b) each."""
    flat = page.evaluate(PIXELS, [round(x), round(y), width, height])
    row = 4 * width
    return [
        [tuple(flat[i : i + 3]) for i in range(start, start + row, 4)]
        for start in range(0, len(flat), row)
    ]


def is_near(a: tuple[int, ...], b: list[int], within: int = 24) -> bool:
    """Whether two colours are the same to the eye."""
    return all(abs(p - q) <= within for p, q in zip(a, b, strict=True))


def count(page: Any, name: str) -> int:
    """How many pixels of the map have a colour of its palette."""
    return int(page.evaluate(COUNT, page.evaluate(COLOUR, name)))


def lonely(page: Any, places: dict[str, tuple[float, float]]) -> str:
    """The first of some things, in m, that has nothing else of the map's signs near it."""
    signs = page.evaluate(
        """[...["vehicles", "rsus", "orders"].flatMap((name) => [...tables[name].values()]),
          ...map._scene.network.depots].map(({x, y}) => [x, y])"""
    )
    return next(
        name
        for name, place in places.items()
        if sum(math.dist(place, sign) < 120 for sign in signs) <= (place in map(tuple, signs))
    )


def corners(box: dict[str, float]) -> list[tuple[float, float]]:
    """Corners of a turned rectangle."""
    sin, cos = math.sin(box["angle"]), math.cos(box["angle"])
    return [
        (
            box["x"] + sx * box["width"] / 2 * cos - sy * box["height"] / 2 * sin,
            box["y"] + sx * box["width"] / 2 * sin + sy * box["height"] / 2 * cos,
        )
        for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]


def overlap_px(a: list[tuple[float, float]], b: list[tuple[float, float]]) -> float:
    """How deep two convex shapes overlap; not above 0 if they do not."""
    depth = math.inf
    for shape in (a, b):
        for (x0, y0), (x1, y1) in zip(shape, shape[1:] + shape[:1], strict=True):
            length = math.hypot(x1 - x0, y1 - y0)
            nx, ny = (y1 - y0) / length, (x0 - x1) / length
            first = [nx * x + ny * y for x, y in a]
            second = [nx * x + ny * y for x, y in b]
            depth = min(depth, max(first) - min(second), max(second) - min(first))
    return depth


def assert_apart(labels: list[dict[str, Any]]) -> None:
    """No two labels lie on each other."""
    shapes = [(label, corners(label)) for label in labels]
    for (one, a), (other, b) in itertools.combinations(shapes, 2):
        if math.hypot(one["x"] - other["x"], one["y"] - other["y"]) < 400:
            assert overlap_px(a, b) < 0.01, (one["text"], other["text"])


def test_overlapping_labels_would_be_found():
    """The ruler of the tests below finds an overlap, also of turned boxes."""
    box = {"x": 0.0, "y": 0.0, "width": 40.0, "height": 10.0, "angle": 0.0}
    turned = {**box, "x": 26.0, "y": 12.0, "angle": math.pi / 2}
    assert overlap_px(corners(box), corners({**box, "x": 30.0})) == pytest.approx(10.0)
    assert overlap_px(corners(box), corners(turned)) < 0
    with pytest.raises(AssertionError):
        assert_apart([{**box, "text": "a"}, {**turned, "x": 20.0, "text": "b"}])


def test_labels_in_troy_never_overlap_and_name_what_is_there(town):
    """Depots, vehicles and streets have names, at no scale one on another."""
    for zoom in (1, 3, 3, 3):
        town.evaluate("(zoom) => { map._change(() => map._view.zoom(zoom)); map._frame(); }", zoom)
        labels = town.evaluate("map._frame(), map.labels()")
        assert_apart(labels)
        if zoom == 1:
            found = {(label["kind"], label["id"]) for label in labels}
            assert {("depot", f"depot-{n}") for n in range(3)} <= found
            assert sum(kind == "vehicle" for kind, _ in found) >= 5
            assert sum(kind == "street" for kind, _ in found) >= 2
    town.evaluate("map.fit(); map.select('vehicle', 'van-004')")
    labels = town.evaluate("map._frame(), map.labels()")
    assert_apart(labels)
    assert "van-004" in {label["id"] for label in labels}


@pytest.fixture(scope="module")
def crowded(open_map: OpenMap) -> Any:
    """Troy with more vehicles than there is room for at most sizes."""
    network = map_data.troy()
    return open_map(network, map_data.moment(network, 12, 8, 8, 20))


def fitted(page: Any, width: int, height: int) -> Any:
    """The page at a size, with the whole map in it."""
    page.set_viewport_size({"width": width, "height": height})
    page.wait_for_function(f"map._view.width === {width} && map._view.height === {height}")
    page.evaluate("map.fit(); map._frame()")
    return page


def assert_uncut(labels: list[dict[str, Any]], width: int, height: int) -> None:
    """No label lies on the edge of what is seen."""
    for label in labels:
        xs, ys = zip(*corners(label), strict=True)
        cut = min(xs) < 0 < max(xs) or min(xs) < width < max(xs)
        cut = cut or min(ys) < 0 < max(ys) or min(ys) < height < max(ys)
        seen = max(xs) > 0 and min(xs) < width and max(ys) > 0 and min(ys) < height
        assert not (cut and seen), label["text"]


@pytest.mark.parametrize(("width", "height"), [(390, 300), (900, 600)])
def test_no_name_of_the_fitted_map_is_cut_off_at_its_edge(crowded, width, height):
    """Signs that lie near the edge have their names on its inner side, or none."""
    page = fitted(crowded, width, height)
    for zoom in (1, 2, 2):
        page.evaluate("(zoom) => { map._change(() => map._view.zoom(zoom)); map._frame(); }", zoom)
        page.wait_for_function("() => { map._frame(); return map._layers._covers(map._view); }")
        labels = page.evaluate("map._frame(), map.labels()")
        assert len(labels) >= 3
        assert_uncut(labels, width, height)


@pytest.mark.parametrize("is_open", [False, True], ids=["closed", "open"])
@pytest.mark.parametrize(("width", "height"), [(390, 260), (900, 600)])
def test_no_name_or_sign_of_the_fitted_map_lies_under_buttons_or_legend(
    crowded, width, height, is_open
):
    """Names keep clear of what lies over the map; vehicles too, of a legend if there is room."""
    page = fitted(crowded, width, height)
    page.evaluate("(open) => { document.querySelector('.map-legend').open = open; }", is_open)
    page.wait_for_function(
        "(open) => { map._frame(); const [, , , legend] = map._controls.covered();"
        " return (legend.height > 60) === open && map._layers._covers(map._view); }",
        arg=is_open,
    )
    over = page.evaluate("map._controls.covered()")
    for label in page.evaluate("map._frame(), map.labels()"):
        for box in over:
            assert overlap_px(corners(label), corners(box)) < 0.01, label["text"]
    signs = page.evaluate(
        "[...map._scene.motion.movers.values()].map((m) => [map._view.px(m.x), map._view.py(m.y)])"
    )
    hides = over[:1] + (over[3:] if is_open and width > 600 else [])
    for x, y in signs:
        for box in hides:
            inside = abs(x - box["x"]) < box["width"] / 2 and abs(y - box["y"]) < box["height"] / 2
            assert not inside, (x, y)


def test_names_of_roadside_units_lie_clear_of_roads_lines(street):
    """Beside the lines, not on them; one on lines has a ground of its own."""
    street.evaluate(
        """() => {
          tables.rsus.set("rsu-on-road", {x: 250, y: 0, level: "ok", status: "ok", segments: []});
          map.setMoment(tables, {rsus: new Set(["rsu-on-road"])});
        }"""
    )
    labels = street.evaluate("map._frame(), map.labels()")
    (label,) = (one for one in labels if one["id"] == "rsu-on-road")
    _, y = street.evaluate("map.placeOf('road', 'turbulent')")
    assert abs(label["y"] - y) > label["height"] / 2 + 4
    assert not label.get("plate")
    street.evaluate(
        """() => {
          tables.rsus.delete("rsu-on-road");
          map.setMoment(tables, {rsus: new Set(["rsu-on-road"])});
        }"""
    )


@pytest.mark.long
def test_a_cluster_leaves_the_depot_in_sight(open_map):
    """Vehicles that stand at it are counted beside it."""
    moment = three_roads()
    for name in ("a", "b"):
        moment["vehicles"][name].update(x=100, y=0)
    network = {**STREETS, "depots": [{"id": "depot", "x": 100, "y": 0}]}
    page = open_map(network, moment, width=600, height=400)
    x, y, radius, away = page.evaluate(
        """(map._frame(), (() => {
          const [{x, y, radius}] = map._scene.circles(map._view);
          return [x, y, radius, Math.hypot(x - map._view.px(100), y - map._view.py(0))];
        })())"""
    )
    assert away > radius + 8
    assert page.evaluate("([x, y]) => map.at(x, y)", [x, y])["kind"] == "cluster"


def test_street_names_lie_along_their_streets(town):
    """A name is parallel to a road of its name, and beside it."""
    town.evaluate("map._change(() => map._view.zoom(4)); map._frame()")
    # Labels are placed anew once the map stands still.
    town.wait_for_function("map.labels().filter((label) => label.kind === 'street').length > 10")
    labels = [label for label in town.evaluate("map.labels()") if label["kind"] == "street"]
    for label in labels:
        assert abs(label["angle"]) <= math.pi / 2 + 0.02
        away = town.evaluate(
            """({x, y, angle, text}) => Math.min(...map._scene.network.roads
              .filter((road) => road.name === text)
              .map((road) => {
                const [ax, ay, bx, by] = [0, 1, road.shape.length - 2, road.shape.length - 1]
                  .map((i) => i % 2 ? map._view.py(road.shape[i]) : map._view.px(road.shape[i]));
                const turn = Math.abs(Math.sin(Math.atan2(by - ay, bx - ax) - angle));
                const length = Math.hypot(bx - ax, by - ay);
                const off = Math.abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / length;
                return turn < 0.2 ? off : Infinity;
              }))""",
            label,
        )
        assert away < 35, label["text"]


def test_click_selects_the_vehicle_rsu_and_order_that_is_there(town):
    """A click on a sign tells its kind and id; one beside all signs tells nothing."""
    for kind in ("vehicle", "rsu", "order"):
        rows = town.evaluate("(kind) => [...tables[`${kind}s`]]", kind)
        name = lonely(town, {name: (row["x"], row["y"]) for name, row in rows})
        town.evaluate("([kind, name]) => { map.select(null); map.show(kind, name); }", [kind, name])
        town.evaluate("map._change(() => map._view.zoom(3)); map._frame()")
        x, y = town.evaluate("([kind, name]) => map.placeOf(kind, name)", [kind, name])
        town.mouse.click(x, y)
        assert town.evaluate("window.selected.at(-1)") == [kind, name]
        assert town.evaluate("map._scene.selection") == {"kind": kind, "id": name}
    town.mouse.click(40, 400)
    town.evaluate("map.fit(); map._frame()")
    town.mouse.click(60, 350)
    assert town.evaluate("window.selected.at(-1)") == [None, None]


def test_click_beside_a_street_selects_the_direction_of_that_side(town):
    """Of a two-way street the direction is found on whose side the click is."""
    shapes = {road["id"]: road["shape"] for road in town.network["roads"]}
    back = {name: "-".join(reversed(name.split("-"))) for name in shapes}
    middles = {
        name: ((shape[0] + shape[-2]) / 2, (shape[1] + shape[-1]) / 2)
        for name, shape in shapes.items()
        if back[name] in shapes and math.dist(shape[:2], shape[-2:]) > 200
    }
    road = lonely(town, middles)
    for name in (road, back[road]):
        town.evaluate("(name) => map.show('road', name)", name)
        shape = shapes[name]
        length = math.hypot(shape[2] - shape[0], shape[3] - shape[1])
        right = [(shape[3] - shape[1]) / length, -(shape[2] - shape[0]) / length]
        x, y = town.evaluate("(name) => map.placeOf('road', name)", name)
        town.mouse.click(x + 4 * right[0], y - 4 * right[1])
        assert town.evaluate("window.selected.at(-1)") == ["road", name]


def test_nearest_thing_within_eight_pixels_is_found_and_sixteen_by_a_finger(town):
    """Reach is counted from a sign's edge."""
    town.evaluate("map.show('vehicle', 'van-006')")
    town.evaluate("map._change(() => map._view.zoom(4)); map._frame()")
    x, y = town.evaluate("map.placeOf('vehicle', 'van-006')")
    find = "([x, y, within]) => map.at(x, y, within)"
    radius = 11
    hits = {
        (away, within): town.evaluate(find, [x, y - radius - away, within])
        for away, within in ((7, 8), (12, 8), (12, 16), (20, 16))
    }
    is_van = {key: (hit or {}).get("id") == "van-006" for key, hit in hits.items()}
    assert is_van == {(7, 8): True, (12, 8): False, (12, 16): True, (20, 16): False}


def test_flags_are_told_apart_by_their_pattern(street):
    """Stable is a solid line, turbulent dashed, unknown dotted."""
    runs = {}
    for flag in ("stable", "turbulent", "unknown"):
        colour = street.evaluate(COLOUR, f"--map-{flag}")
        x, y = street.evaluate("(flag) => map.placeOf('road', flag)", flag)
        rows = pixels(street, x - 150, y - 4, 300, 14)
        drawn = max(([is_near(p, colour) for p in row] for row in rows), key=sum)
        runs[flag] = (sum(drawn) / 300, sum(1 for key, _ in itertools.groupby(drawn) if key))
    assert runs["stable"] == (1.0, 1)
    assert 0.5 < runs["turbulent"][0] < 0.8
    assert 0.15 < runs["unknown"][0] < 0.6
    assert runs["unknown"][1] > 1.5 * runs["turbulent"][1] > 8


def test_reported_vehicle_is_filled_and_one_by_plan_is_hollow(street):
    """Colour inside, or only around."""
    for name, colour in (("a", "--vehicle-0"), ("b", "--map-halo")):
        x, y = street.evaluate("(name) => map.placeOf('vehicle', name)", name)
        # Beside the letter in its middle.
        [[pixel]] = pixels(street, x - 7, y, 1, 1)
        assert is_near(pixel, street.evaluate(COLOUR, colour)), name
    edge = street.evaluate(COLOUR, "--vehicle-3")
    x, y = street.evaluate("map.placeOf('vehicle', 'b')")
    assert any(is_near(p, edge) for row in pixels(street, x - 12, y - 12, 24, 24) for p in row)


def test_platoon_line_goes_at_once_when_its_gate_closes(street):
    """The next rows take the line away, though the vehicle's own row still has it."""
    gate = """(gate) => {
      tables.roads.get("stable").gate = gate;
      map.setMoment(tables, {roads: new Set(["stable"])});
    }"""
    assert count(street, "--map-platoon-fill") > 300
    street.evaluate(gate, "closed")
    # Edges of signs and names blend into any colour.
    assert count(street, "--map-platoon-fill") < 20
    street.evaluate(gate, "open")
    assert count(street, "--map-platoon-fill") > 300


def test_selected_route_is_drawn_its_past_faint_and_all_else_dimmed(street):
    """A vehicle's way and a road stand out; no other road keeps its full colour."""
    before = {name: count(street, name) for name in ("--map-turbulent", "--vehicle-3")}
    colour = street.evaluate(COLOUR, "--vehicle-3")
    street.evaluate("map.select('vehicle', 'b')")
    assert count(street, "--vehicle-3") > before["--vehicle-3"] + 500

    def share(road: str) -> float:
        x, y = street.evaluate("(road) => map.placeOf('road', road)", road)
        rows = pixels(street, x - 150, y - 3, 300, 16)
        return sum(any(is_near(row[i], colour) for row in rows) for i in range(300)) / 300

    assert share("unknown") > 0.95
    assert share("turbulent") == 0
    street.evaluate("map.select('road', 'stable')")
    assert count(street, "--map-turbulent") == 0
    assert count(street, "--map-stable") > 1000
    street.evaluate("map.select(null)")
    assert count(street, "--map-turbulent") == before["--map-turbulent"]


def test_tooltip_says_by_plan_and_shows_markup_as_text(street):
    """What a message says is text, never markup."""
    for name, says in (("b", "by plan"), ("<img src=x onerror=fail()>", "<b>bold</b>")):
        x, y = street.evaluate("(name) => map.placeOf('vehicle', name)", name)
        street.mouse.move(x, y)
        text = street.locator(".map-tooltip").inner_text()
        assert name in text
        assert says in text
    assert street.locator(".map-tooltip :is(img, b)").count() == 0
    street.mouse.move(300, 398)
    assert street.locator(".map-tooltip").is_hidden()
    assert street.errors == []


def test_keys_wheel_drag_buttons_and_double_click_move_the_map(town):
    """Each way to move the map moves it, and what lies under the pointer stays there."""
    state = "[map._view.scale, map._view.x, map._view.y]"
    whole = town.evaluate(state)
    town.locator(".map-canvas").focus()
    town.keyboard.press("+")
    assert town.evaluate(state)[0] == pytest.approx(1.5 * whole[0])
    town.keyboard.press("ArrowRight")
    town.keyboard.press("ArrowUp")
    moved = town.evaluate(state)
    assert moved[1] > whole[1]
    assert moved[2] > whole[2]
    town.keyboard.press("0")
    assert town.evaluate(state) == pytest.approx(whole)
    under = "[map._view.mx(300), map._view.my(200)]"
    place = town.evaluate(under)
    town.mouse.move(300, 200)
    town.mouse.wheel(0, -200)
    town.wait_for_function("(scale) => map._view.scale > scale * 1.2", arg=whole[0])
    assert town.evaluate(under) == pytest.approx(place)
    town.mouse.down()
    town.mouse.move(350, 230, steps=3)
    town.mouse.up()
    assert town.evaluate("[map._view.mx(350), map._view.my(230)]") == pytest.approx(place)
    assert town.evaluate("window.selected.length") == 0
    scale = town.evaluate("map._view.scale")
    town.get_by_role("button", name="Zoom in").click()
    assert town.evaluate("map._view.scale") == pytest.approx(1.6 * scale)
    town.get_by_role("button", name="Zoom out").click()
    town.mouse.dblclick(350, 230)
    assert town.evaluate("map._view.scale") == pytest.approx(2 * scale)
    town.get_by_role("button", name="Show the whole map").click()
    assert town.evaluate(state) == pytest.approx(whole)


def test_map_follows_the_size_of_its_container_and_tells_its_content_in_words(town):
    """All of the network stays in view, and a text sums up what is seen."""
    town.set_viewport_size({"width": 390, "height": 500})
    town.wait_for_function("map._view.width === 390 && map._view.height === 500")
    corners_px = town.evaluate(
        """(([x0, y0, x1, y1]) => [map._view.px(x0), map._view.py(y1), map._view.px(x1),
          map._view.py(y0)])(map._scene.network.bounds)"""
    )
    assert min(corners_px) >= 0
    assert corners_px[2] <= 390
    assert corners_px[3] <= 500
    town.set_viewport_size({"width": 1000, "height": 700})
    town.wait_for_function("map._view.width === 1000")
    town.evaluate("map.select('vehicle', 'van-001')")
    words = town.get_by_role("img", name="Map of").get_attribute("aria-label")
    assert "470 roads" in words
    assert "6 vehicles shown of 6, 2 by plan" in words
    assert "20 stable, 20 turbulent, 20 unknown" in words
    assert "Selected: vehicle van-001" in words


def test_picture_is_a_png_of_twice_the_size_with_a_legend_below(town):
    """Two pixels for one, and higher than the map."""
    data = base64.b64decode(
        town.evaluate(
            """async () => {
              const blob = await map.toPNG({text: "Troy"});
              const url = await new Promise((done) => {
                const reader = new FileReader();
                reader.onload = () => done(reader.result);
                reader.readAsDataURL(blob);
              });
              return url.split(",")[1];
            }"""
        )
    )
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert width == 2000
    assert height > 1500


def test_themes_have_colours_of_their_own(town):
    """Dark land in the dark theme, and back."""
    light = pixels(town, 5, 300, 1, 1)[0][0]
    town.evaluate("map.setTheme('dark')")
    dark = pixels(town, 5, 300, 1, 1)[0][0]
    town.evaluate("map.setTheme('light')")
    assert min(light) > 200
    assert max(dark) < 50
    assert pixels(town, 5, 300, 1, 1)[0][0] == light


CONTRASTS = """async (theme) => {
  const { channels, contrast, readPalette } = await import("./map/paint/palette.js");
  map.setTheme(theme);
  const palette = readPalette(map._root);
  return palette.names.map((name) => contrast(channels(name), channels(palette.halo)));
}"""


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_names_of_vehicles_are_read_easily(town, theme):
    """WCAG AA asks for 4.5 to 1 of a text."""
    contrasts = town.evaluate(CONTRASTS, theme)
    assert len(contrasts) == 12
    assert min(contrasts) >= 4.5


@pytest.mark.long
def test_vehicles_glide_between_messages_while_all_else_stays_drawn(open_map):
    """Moving vehicles cost no drawing of roads."""
    page = open_map(STREETS, three_roads(), query="theme=light", width=600, height=400)
    page.evaluate("map._frame(); window.drawn = map._layers._drawnAt; window.seen = []")
    start = page.evaluate("map._scene.motion.movers.get('a').x")
    page.evaluate(
        """() => {
          step(60);
          const look = () => {
            const {x} = map._scene.motion.movers.get("a");
            window.seen.push(x);
            if (x < 179) requestAnimationFrame(look);
          };
          look();
        }"""
    )
    page.wait_for_function("window.seen.at(-1) > 179")
    seen = page.evaluate("window.seen")
    assert seen[0] == start == 120
    assert seen == sorted(seen)
    assert any(121 < x < 179 for x in seen)
    page.wait_for_function("!map._scene.motion.isMoving")
    assert page.evaluate("map._scene.motion.movers.get('a').x") == 180
    assert page.evaluate("map._layers._drawnAt === window.drawn")
    assert page.errors == []


def test_vehicles_at_one_place_are_one_sign_that_gives_them_in_turn(street):
    """One number for all; each click selects the next."""
    street.evaluate(
        """() => {
          const row = tables.vehicles.get("a");
          for (const id of ["p1", "p2", "p3"]) tables.vehicles.set(id, {...row, x: 400, y: -40});
          map.setMoment(tables, {vehicles: new Set(["p1", "p2", "p3"])});
          map._frame();
        }"""
    )
    x, y = street.evaluate("map.placeOf('vehicle', 'p1')")
    street.mouse.move(x, y)
    assert "3 vehicles" in street.locator(".map-tooltip").inner_text()
    names = []
    for _ in range(3):
        street.mouse.click(x, y)
        names.append(street.evaluate("window.selected.at(-1)")[1])
        # Two clicks at one place within the system's time are a double click.
        street.mouse.move(x, y)
        street.evaluate("map.fit(); map._frame()")
    assert names == ["p1", "p2", "p3"]
    street.evaluate(
        """() => {
          map.select(null);
          for (const id of ["p1", "p2", "p3"]) tables.vehicles.delete(id);
          map.setMoment(tables, {vehicles: new Set(["p1", "p2", "p3"])});
        }"""
    )
    assert street.evaluate("map.placeOf('vehicle', 'p1')") is None


@pytest.mark.long
def test_fingers_tap_drag_and_pinch(open_map):
    """Real touch events: a tap selects, one finger drags, two zoom."""
    page = open_map(STREETS, three_roads(), width=390, height=600, has_touch=True)
    x, y = page.evaluate("map.placeOf('vehicle', 'a')")
    page.touchscreen.tap(x, y - 22)
    assert page.evaluate("window.selected.at(-1)") == ["vehicle", "a"]
    devtools = page.context.new_cdp_session(page)

    def touch(kind: str, *points: tuple[float, float]) -> None:
        touches = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        devtools.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    place = page.evaluate("[map._view.mx(200), map._view.my(300)]")
    touch("touchStart", (200, 300))
    for step in range(1, 6):
        touch("touchMove", (200 + 10 * step, 300 + 8 * step))
    touch("touchEnd")
    assert page.evaluate("[map._view.mx(250), map._view.my(340)]") == pytest.approx(place, abs=0.1)
    scale = page.evaluate("map._view.scale")
    touch("touchStart", (150, 300), (250, 300))
    for step in range(1, 6):
        touch("touchMove", (150 - 10 * step, 300), (250 + 10 * step, 300))
    touch("touchEnd")
    assert page.evaluate("map._view.scale") == pytest.approx(2 * scale, rel=0.02)
    assert page.evaluate("window.selected.length") == 1
    assert page.errors == []
